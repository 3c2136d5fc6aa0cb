/* Handshake, resume and removal of sessions, for the model checker spin: tests/test_session_model.py.

   One visitor with a ticket for one use, one server with a store, an operator who removes the visitor once, and a
   network that is the enemy's: all that was ever sent can be delivered at any time, in any order, again and again, or
   never. It makes no record and no secret of its own: those need keys. The visitor is nobody's friend either: it may use
   any secret that it ever had. Server and client may be killed at any moment; the store and the client's file stay.

   A connection has one handshake. Its keys come from the client's ephemeral key (`hello`) and the server's (the
   connection), so only the client makes `record`, and only for an answer that it read while it waited for one.

   Claims, each an assertion:
   RECORD   nobody is admitted without a first record that the client made for this very connection;
   REMOVED  who was removed has no session once that is acknowledged, whatever it resumes with;
   ONE      there is at most one session, and the ticket has at most one visitor that confirmed a secret;
   REPLAY   a first message, also a repeated one, ends no session and admits nobody;
   KEPT     the server accepts the secret that the client keeps, or the ticket, until it is removed.

   Broken on purpose, each must violate a claim: FORGED (the first record is not checked), NO_RECHECK (a secret to resume
   with is looked up with the first message only; with NOT_KEPT, which leaves that claim out), ACK_FIRST (removal is acknowledged before it is on disk), TICKET_LIVES (a removal
   leaves the ticket), TWO_SESSIONS (resuming leaves the session that was there), TICKET_LATE (the use of a ticket is not
   checked again), AT_HELLO (a first message ends the session that was there), SECRET_DIES (the secret before dies when
   the next one is sent), RENEWED (a secret that was not confirmed is replaced by another one), SPENT (the use of the
   ticket counts with the first record, before its visitor has a secret), UNSPENT (it never counts). */

#define HELLOS 3                    /* that the client makes; the network may deliver each again */
#define CONNECTIONS 4
#define SECRETS 4
#define TICKET 1                    /* the secret of the ticket; those to resume with come after it */
#define UNUSED 99                   /* a secret that nobody has */
#define NEWCOMER (row && !secret)   /* it has confirmed no secret, and the ticket's use does not count yet */

#define PENDING 1                   /* its first message was answered */
#define OPEN 2
#define CLOSED 3

/* What was ever sent: */
byte hello[HELLOS + 1];             /* the secret that it names */
bool record[CONNECTIONS + 1];       /* the first record */
byte given[CONNECTIONS + 1];        /* the secret to resume with */
bool stored[SECRETS + 1];           /* the client has it on disk */
/* The server's store: */
bool disk_row, disk_ticket = true;
byte disk_secret, disk_pending;
/* Its memory: */
bool row, ticket = true;
byte secret, pending;
byte state[CONNECTIONS + 1], from[CONNECTIONS + 1];
byte connections, secrets = TICKET;
/* The operator: */
byte removing;                      /* steps that are done */
bool acknowledged, was_removed;
byte confirmed;                     /* visitors by the ticket */
/* The client: */
bool had[SECRETS + 1];              /* secrets that it ever had */
byte kept = TICKET;                 /* the newest */
byte hellos;
bool waits;                         /* for an answer to the newest hello */
byte joined;                        /* connection whose keys it has */

/* A removal is one call: between its write and its end the server can only be killed. */
#define READY (removing != 1)
#define VALID(s) ((s == TICKET && ticket) || (row && (s == secret || s == pending)))

inline close_all()
{
	for (k : 1 .. CONNECTIONS) {
		state[k] = (state[k] -> CLOSED : 0)
	}
	k = 0
}

/* A handshake that has begun goes on. */
inline close_open()
{
	for (k : 1 .. CONNECTIONS) {
		state[k] = (state[k] == OPEN -> CLOSED : state[k])
	}
	k = 0
}

inline sessions()
{
	n = 0;
	for (k : 1 .. CONNECTIONS) {
		n = n + (state[k] == OPEN)
	}
	k = 0
}

/* A first message comes: the server answers, and nothing else has happened. */
inline answer(h)
{
	sessions();
	before = n;
	connections++;
	from[connections] = h;
	state[connections] = (VALID(hello[h]) -> PENDING : CLOSED);
#ifdef AT_HELLO
	if
	:: state[connections] == PENDING ->
		close_open()
	:: else
	fi;
#endif
	sessions();
	assert(n == before);                                     /* REPLAY */
	before = 0;
	n = 0
}

/* A newcomer has confirmed its secret, with which it stays: the ticket's use counts. */
inline confirm()
{
	confirmed++;
	assert(confirmed <= 1);                                  /* ONE */
#ifndef UNSPENT
	ticket = false;
	disk_ticket = false
#endif
}

/* A first record comes. The store is written before the secret is sent. A newcomer takes another's place. */
inline admit(c)
{
	named = hello[from[c]];
	if
#ifdef NO_RECHECK
	:: named != TICKET || VALID(named) ->
#else
#ifdef TICKET_LATE
	:: named == TICKET || VALID(named) ->
#else
	:: VALID(named) ->
#endif
#endif
		assert(record[c]);                               /* RECORD */
#ifndef TWO_SESSIONS
		close_open();
#endif
		/* What the visitor may have, and has not confirmed, is given again. */
#ifndef RENEWED
		again = row && named == secret && pending;
#endif
		if
		:: named != TICKET && NEWCOMER -> confirm()
		:: else
		fi;
		secrets = secrets + !again;
		pending = (again -> pending : secrets);
		secret = (named == TICKET -> 0 : named);
#ifdef SPENT
		ticket = ticket && named != TICKET;
#endif
#ifdef SECRET_DIES
		secret = (named == TICKET -> 0 : UNUSED);
#endif
		row = true;
		disk_row = row;
		disk_ticket = ticket;
		disk_secret = secret;
		disk_pending = pending;
		state[c] = OPEN;
		given[c] = pending
	:: else -> state[c] = CLOSED
	fi;
	again = false;
	named = 0
}

active proctype World()
{
	byte c, k, n, before, named;
	bool again;

	had[TICKET] = true;
	do
	/* --- the client --- */
	:: d_step { hellos < HELLOS && !waits && had[TICKET] -> hellos++; hello[hellos] = TICKET; waits = true; joined = 0 }
	:: d_step { hellos < HELLOS && !waits && had[2] -> hellos++; hello[hellos] = 2; waits = true; joined = 0 }
	:: d_step { hellos < HELLOS && !waits && had[3] -> hellos++; hello[hellos] = 3; waits = true; joined = 0 }
	:: d_step { waits -> waits = false }             /* it gives up, or is killed */
	/* --- the network delivers --- */
	:: atomic { READY && connections < CONNECTIONS && hello[1] -> answer(1) }
	:: atomic { READY && connections < CONNECTIONS && hello[2] -> answer(2) }
	:: atomic { READY && connections < CONNECTIONS && hello[3] -> answer(3) }
	:: atomic { READY ->
		select(c : 1 .. CONNECTIONS);
		if
		/* the answer, to the client */
		:: state[c] && waits && from[c] == hellos -> joined = c; record[c] = true; waits = false
		/* the first record, to the server */
#ifdef FORGED
		:: state[c] == PENDING && secrets < SECRETS -> admit(c)
#else
		:: state[c] == PENDING && secrets < SECRETS && record[c] -> admit(c)
#endif
		/* the secret, to the client, which stores it and says so */
		:: joined == c && given[c] && given[c] != kept ->
			kept = given[c];
			had[kept] = true;
			stored[kept] = true
		/* that it is stored */
		:: state[c] == OPEN && given[c] == pending && pending && stored[pending] ->
			if
			:: NEWCOMER -> confirm()
			:: else
			fi;
			secret = pending;
			pending = 0;
			disk_secret = secret;
			disk_pending = 0
		/* it is cut, or not answered in time */
		:: state[c] == PENDING || state[c] == OPEN -> state[c] = CLOSED
		:: else
		fi;
		sessions();
		assert(n <= 1);                                  /* ONE */
		assert(!acknowledged || n == 0);                 /* REMOVED */
#ifndef NOT_KEPT
		assert(was_removed || VALID(kept) || VALID(TICKET));     /* KEPT */
#endif
		c = 0;
		n = 0
	   }
	/* --- the operator --- */
#ifdef ACK_FIRST
	:: d_step { removing == 0 && row && !acknowledged ->
		row = false;
		ticket = false;
		close_open();
		acknowledged = true;
		was_removed = true;
		removing = 1
	   }
	:: d_step { removing == 1 -> disk_row = false; disk_ticket = false; removing = 2 }
#else
	:: d_step { removing == 0 && row && !acknowledged ->
		disk_row = false;
#ifndef TICKET_LIVES
		disk_ticket = false;
#else
		disk_ticket = true;                      /* of several uses: one is left */
		ticket = true;
		confirmed = 0;
#endif
		was_removed = true;
		removing = 1
	   }
	:: d_step { removing == 1 ->
		row = false;
		ticket = disk_ticket;
		close_open();
		acknowledged = true;
		removing = 2
	   }
#endif
	/* --- the server is killed, and starts again --- */
	:: d_step { true ->
		row = disk_row;
		ticket = disk_ticket;
		secret = disk_secret;
		pending = disk_pending;
		removing = 0;
		close_all()
	   }
	od
}
