/* Bounded-time interaction, as little of it as P1 and P2 need, for the model checker spin: `python firmware/model.py`.

   Four robots, f_max 1. Robot 0 is looked at; 1 to 3 audit it, and 1 of them, robot 1, is its enemy's.
   LIAR 1: robot 0's c-node is the adversary's too, and robot 1 a liar too. It asks whom it wants when it wants,
   keeps requests for as long as it likes and deviates when it wants. Its trusted nodes are right: a token request says
   when it was made and, in profile `hardened`, what the log was then; a token needs a true request to its own auditor.
   P1: whoever deviates is in Safe Mode T_val later.
   LIAR 0: robot 0 is correct. It asks f_max + 1 others in each round, and half a round later others for what is
   missing. Robot 1 answers as it likes. The radio loses what it wants, but of two robots' exchanges at most LOSSES in a
   row. P2: with f_max + 1 correct auditors a correct robot is never in Safe Mode.

   The other robots' own a-nodes are not in it. For P1 they never stop, which helps the liar only. For P2: of all
   correct robots look at the one that would stop first; until then the others answer.
   Time goes in ticks of T_audit / 2, so T_audit is 2 and T_val is 5 of them, as 4 s and 10 s. Times are ages that stop
   where nothing depends on them any more: runs have no end, and all of them are searched.

   Broken on purpose, each of these must violate P1: TOKENS_LAST (T_val is not looked at), ANY_AUDITOR (a token counts,
   whoever gave it), STALE_LOG (as in profile `paper`, a request does not say what the log was), KEY_AGAIN (a second
   mission key in one power-up), NEEDED F_MAX (f_max tokens are enough); and P2: one more of LOSSES, or a shorter T_VAL. */

#ifndef LIAR
#define LIAR 1
#endif
#ifndef LOSSES
#define LOSSES 1
#endif
#ifndef T_VAL
#define T_VAL 5
#endif
#define F_MAX 1
#ifndef NEEDED
#define NEEDED (F_MAX + 1)          /* good tokens */
#endif
#define AUDITORS 3
#define SLOTS 2                     /* f_max + 1 */
#define NONE (T_VAL + 1)            /* older than any that counts */

/* Of robot 0's a-node: */
byte auditor[SLOTS];                    /* whose token; 0: free */
byte age[SLOTS] = NONE;             /* how long ago it was asked for */
byte keyed;                         /* since the mission key came */
bool safe;
/* Of its c-node: */
bool lied;
byte since;                         /* the first lie */
byte kept[AUDITORS + 1] = NONE;     /* a liar's requests that may come to something: how long ago made */
bool answered[AUDITORS + 1];        /* a correct robot: in this round */
/* Of the world: */
byte lost[AUDITORS + 1];            /* exchanges, in a row */
bool second;                        /* half of the round */
bool ticks;                         /* whose turn it is: the clock's, or robot 0's */

/* InstallToken, as keep_token in src/anode.c: one token an auditor; the oldest gives way to a newer. */
inline install(j, a)
{
	d_step {
		place = 0;
		k = 0;
		do
		:: k == SLOTS -> break
#ifndef ANY_AUDITOR
		:: k < SLOTS && auditor[k] == j ->
			age[k] = (a < age[k] -> a : age[k]);
			place = SLOTS;
			break
#endif
		:: else ->
			place = (age[k] > age[place] -> k : place);
			k++
		od;
		if
		:: place < SLOTS && a < age[place] ->
			auditor[place] = j;
			age[place] = a
		:: else
		fi;
		place = 0;
		k = 0
	}
}

/* A correct robot's request, an audit, and the token: all of it, or what of it is lost. */
inline ask(j)
{
	if
	:: lost[j] < LOSSES -> lost[j]++
	:: lost[j] = 0;
		answered[j] = true;
		install(j, 0)
	:: j == 1                       /* a bad auditor can say nothing; a wrong MAC is as good as that */
	fi
}

inline ask_if(wanted, j)
{
	if
	:: wanted && !answered[j] -> ask(j)
	:: else
	fi
}

active proctype Correct() provided (!LIAR && !ticks)
{
	byte k, place, left_out;

	do
	:: atomic {
		if
		:: safe
		:: !safe && !second ->
			answered[1] = false;
			answered[2] = false;
			answered[3] = false;
			if
			:: left_out = 1
			:: left_out = 2
			:: left_out = 3
			fi;
			ask_if(left_out != 1, 1);
			ask_if(left_out != 2, 2);
			ask_if(left_out != 3, 3)
		:: !safe && second ->
			left_out = answered[1] + answered[2] + answered[3];
			ask_if(left_out <= F_MAX, 1);
			ask_if(left_out <= F_MAX, 2);
			ask_if(left_out <= F_MAX, 3)
		fi;
		left_out = 0;
		ticks = true
	   }
	od
}

/* Its a-node makes a request, now. The other liar signs without a log; who replays the log that the request binds and
   finds a lie does not, so a request to such a one is nothing. */
inline may_ask(j)
{
#ifdef STALE_LOG
	!safe -> kept[j] = 0
#else
	!safe -> kept[j] = (lied && j != 1 -> NONE : 0)
#endif
}

/* It is given a token for one, at any time later. */
inline may_get(j)
{
	!safe && kept[j] < NONE -> install(j, kept[j])
}

active proctype Liar() provided (LIAR && !ticks)
{
	byte k, place;

	do
	:: atomic { may_ask(1) }
	:: atomic { may_ask(2) }
	:: atomic { may_ask(3) }
	:: atomic { may_get(1) }
	:: atomic { may_get(2) }
	:: atomic { may_get(3) }
	:: atomic { !lied && !safe -> lied = true }
#ifdef KEY_AGAIN
	:: atomic { keyed = 0 }
#endif
	:: ticks = true
	od
}

#define OLDER(what) what = (what < NONE -> what + 1 : what)

active proctype Clock() provided (ticks)
{
	byte k, good;

	do
	:: d_step {
		/* CheckTokens: f_max + 1 good ones, of different auditors as `install` sees to; or the time of grace. */
		for (k : 0 .. SLOTS - 1) {
#ifdef TOKENS_LAST
			good = good + (auditor[k] != 0)
#else
			good = good + (auditor[k] != 0 && age[k] <= T_VAL)
#endif
		}
		safe = safe || (keyed >= T_VAL && good < NEEDED);
		assert(!LIAR || !lied || since <= T_VAL || safe); /* P1 */
		assert(LIAR || !safe);                           /* P2 */
		OLDER(keyed);
		for (k : 0 .. SLOTS - 1) {
			OLDER(age[k])
		}
		for (k : 1 .. AUDITORS) {
			OLDER(kept[k])
		}
		if
		:: lied -> OLDER(since)
		:: else
		fi;
		second = !second && !LIAR;
		k = 0;
		good = 0;
		ticks = false
	   }
	od
}
