/* What the model checker shows of the trusted nodes: from ANY state that is sound, one call of the interface with ANY
   arguments leaves a sound state and does what is asserted below. A new node is sound, so this holds after any number
   of calls, in any order. `prove.py` chooses CALL and says what stands in for what. */
#include <stdlib.h>

#include "proofs.h"

enum { MAKE, POWER_UP, LOAD_MASTER, LOAD_MISSION, RECV, SEND, ACTUATE, TOKEN_REQUEST, ISSUE_TOKEN, CHECK_TOKEN,
       INSTALL_TOKEN, CHECK, MAKE_SEALED, SEALED_SEND, SEALED_RECV, S_MAKE, S_POWER_UP, S_LOAD_MASTER, S_LOAD_MISSION, S_POLL, S_MAKE_AUTH, S_CHECK_AUTH };

#define OF_SNODE (CALL >= S_MAKE)
#define SEALED (CALL == SEALED_SEND || CALL == SEALED_RECV)
#define FORWARDS (CALL == RECV || CALL == SEND || CALL == ACTUATE || CALL == S_POLL || SEALED)
#define MORE (CALL == SEALED_SEND ? PHX_SEAL_BYTES : 0)
#define MACS (CALL == TOKEN_REQUEST || CALL == ISSUE_TOKEN || CALL == S_MAKE_AUTH)
#define LOADS (CALL == LOAD_MISSION || CALL == S_LOAD_MISSION)
#define RESETS (CALL == MAKE || CALL == POWER_UP || CALL == S_MAKE || CALL == S_POWER_UP)
#define HAS_TIME (FORWARDS || LOADS || CALL == TOKEN_REQUEST || CALL == INSTALL_TOKEN || CALL == CHECK)

/* All that the c-node (and, for MAKE, the manufacturer) chooses, and where answers go. */
typedef struct {
    uint32_t now, len, seq, t;
    uint16_t id;
    uint8_t k[PHX_KEY_BYTES], r[PHX_KEY_BYTES], hash[PHX_HASH_BYTES], mac[PHX_MAC_BYTES], hckpt[PHX_HASH_BYTES];
    uint8_t *packet;
    phx_limits limits;
} words;

typedef struct {
    int result;
    uint8_t *entry, out[PHX_TREQ_OUT_BYTES];
} answer;

struct chance chance;

static void anything(void)
{
    struct chance any;  /* what has no value yet has any */

    chance = any;
}

static int sound_node(const phx_node *node)
{
    const phx_limits *limits = &node->flash.limits;

    return limits->f_max <= PHX_F_MAX && limits->batch_size > 0 && limits->bucket_period_ms > 0 &&
           node->batched < limits->batch_size && !(node->safe && node->has_key) && !(node->has_key && !node->was_keyed) &&
           !(node->has_key && !node->flash.has_master) && node->has_key <= 1 && node->safe <= 1 && node->was_keyed <= 1;
}

static int sound_buckets(const phx_anode *a)
{
    const phx_limits *limits = &a->node.flash.limits;

    return a->requests.level <= (uint64_t)limits->bucket_capacity * limits->bucket_period_ms &&
           a->send.level <= (uint64_t)limits->send_capacity_us * 1000u &&
           a->audit.level <= (uint64_t)limits->audit_capacity_us * 1000u;
}

/* Auditors lie from the first place on, at most f_max + 1, none twice, and no token is of the future. */
static int sound_tokens(const phx_anode *a, uint32_t now, unsigned i, unsigned j)
{
    const phx_token *one = &a->tokens[i], *before = &a->tokens[j];

    return one->auditor == 0 || (i <= a->node.flash.limits.f_max && one->t <= now &&
                             (j >= i || (before->auditor != 0 && before->auditor != one->auditor)));
}

static int sound_times(const phx_anode *a, uint32_t now)
{
    return a->keyed_at_ms <= now && a->requests.filled_at_ms <= now && a->send.filled_at_ms <= now &&
           a->audit.filled_at_ms <= now;
}

static void given_sound(const phx_anode *a, uint32_t now)
{
    given(sound_node(&a->node));
    given(sound_buckets(a));
    given(sound_times(a, now));
    for (unsigned i = 0; i < PHX_TOKENS; i++)
        for (unsigned j = 0; j <= i; j++)
            given(sound_tokens(a, now, i, j));
}

/* Senders lie from the first place on, none twice, and nothing came later than now. */
static int sound_source(const phx_seals *seals, uint32_t now, unsigned i, unsigned j)
{
    const phx_source *one = &seals->sources[i], *before = &seals->sources[j];

    return one->src == 0 || (one->quickest_ms <= now && (j >= i || (before->src != 0 && before->src != one->src)));
}

static int same_source(const phx_source *one, const phx_source *other)
{
    return one->src == other->src && one->newest == other->newest && one->seen[0] == other->seen[0] &&
           one->seen[1] == other->seen[1] &&
           one->quickest_t == other->quickest_t && one->quickest_ms == other->quickest_ms;
}

static uint32_t good_tokens(const phx_anode *a, uint32_t now)
{
    uint32_t count = 0;

    for (unsigned i = 0; i < PHX_TOKENS; i++)
        count += a->tokens[i].auditor != 0 && now <= (uint64_t)a->tokens[i].t + a->node.flash.limits.t_val_ms;
    return count;
}

static answer call(phx_anode *a, phx_snode *s, phx_seals *seals, const words *w, uint8_t *entry)
{
    answer got = {0};

    got.entry = entry;
    chance.drawn = 0;
    switch (CALL) {
    case MAKE:
        got.result = phx_anode_make(a, &w->limits);
        break;
    case POWER_UP:
        phx_anode_power_up(a);
        break;
    case LOAD_MASTER:
        got.result = phx_anode_load_master(a, w->k, w->id);
        break;
    case LOAD_MISSION:
        got.result = phx_anode_load_mission(a, w->now, w->k, w->r, w->seq, w->mac);
        break;
    case RECV:
        got.result = phx_anode_recv(a, w->now, w->packet, w->len, entry);
        break;
    case SEND:
        got.result = phx_anode_send(a, w->now, w->packet, w->len, entry);
        break;
    case ACTUATE:
        got.result = phx_anode_actuate(a, w->now, w->packet, w->len, entry);
        break;
    case TOKEN_REQUEST:
        got.result = phx_anode_token_request(a, w->now, w->id, got.out);
        break;
    case ISSUE_TOKEN:
        got.result = phx_anode_issue_token(a, w->id, w->t, w->hash, w->mac, w->hckpt, got.out);
        break;
    case CHECK_TOKEN:
        got.result = phx_anode_check_token(a, w->id, (uint16_t)w->seq, w->t, w->hckpt, w->mac);
        break;
    case INSTALL_TOKEN:
        got.result = phx_anode_install_token(a, w->now, w->id, w->t, w->hckpt, w->mac);
        break;
    case CHECK:
        got.result = phx_anode_check(a, w->now);
        break;
    case MAKE_SEALED:
        got.result = phx_sealed_make(a);
        break;
    case SEALED_SEND:
        got.result = phx_sealed_send(seals, a, w->now, w->packet, w->len, entry);
        break;
    case SEALED_RECV:
        got.result = phx_sealed_recv(seals, a, w->now, w->packet, w->len, entry);
        break;
    case S_MAKE:
        got.result = phx_snode_make(s, &w->limits);
        break;
    case S_POWER_UP:
        phx_snode_power_up(s);
        break;
    case S_LOAD_MASTER:
        got.result = phx_snode_load_master(s, w->k, w->id);
        break;
    case S_LOAD_MISSION:
        got.result = phx_snode_load_mission(s, w->now, w->k, w->r, w->seq, w->mac);
        break;
    case S_POLL:
        got.result = phx_snode_poll(s, w->now, w->packet, w->len, entry);
        break;
    case S_MAKE_AUTH:
        got.result = phx_snode_make_auth(s, w->mac, got.out);
        break;
    case S_CHECK_AUTH:
        got.result = phx_snode_check_auth(s, w->hash, w->id, w->hckpt, w->mac);
        break;
    }
    return got;
}

void prove(void)
{
    phx_anode a, before;
    phx_snode s;
    phx_seals seals, seals_before;
    phx_node *node = OF_SNODE ? &s.node : &a.node, was;
    words w;
    answer got;
    uint32_t last, now, at;
    uint8_t *entry, old;

    anything();
    given(last <= w.now);
    if (OF_SNODE && CALL != S_MAKE)
        given(sound_node(node));
    if (!OF_SNODE && CALL != MAKE)
        given_sound(&a, last);
    for (unsigned i = 0; SEALED && i < PHX_SOURCES; i++)
        for (unsigned j = 0; j <= i; j++)
            given(sound_source(&seals, last, i, j));
    /* What is too long is refused before it is looked at: nothing is there. */
    w.packet = malloc(w.len <= PHX_PACKET_MAX ? w.len : 0);
    entry = malloc(PHX_ENTRY_HEADER_BYTES + (w.len <= PHX_PACKET_MAX ? w.len + MORE : 0));
    given(w.packet && entry && at < PHX_ENTRY_HEADER_BYTES);
    old = entry[at];
    before = a;
    seals_before = seals;
    was = *node;
    now = HAS_TIME ? w.now : last;
    if (CALL == POWER_UP || CALL == S_POWER_UP)
        now = 0;

    got = call(&a, &s, &seals, &w, entry);

    if (got.result >= 0 || (CALL != MAKE && CALL != S_MAKE)) {
        always(sound_node(node), "a sound node stays sound: no key in Safe Mode, none without a load");
        if (!OF_SNODE) {
            always(sound_buckets(&a), "buckets: never below zero nor above capacity");
            always(sound_times(&a, now), "nothing is later than now");
            for (unsigned i = 0; i < PHX_TOKENS; i++)
                for (unsigned j = 0; j <= i; j++)
                    always(sound_tokens(&a, now, i, j), "tokens: f_max + 1 at most, no auditor twice, none of the future");
        }
    }
    always(RESETS || !was.safe || node->safe, "Safe Mode is left by power-up only");
    always(!HAS_TIME || now != UINT32_MAX || node->safe, "a clock at its end means Safe Mode");
    always(!HAS_TIME || now != UINT32_MAX || !(FORWARDS || MACS || LOADS) || got.result < 0, "and nothing is done then");
    if (CALL != MAKE && CALL != S_MAKE) {
        always(node->flash.key_seq >= was.flash.key_seq, "the mission number only rises");
        always(LOADS || node->flash.key_seq == was.flash.key_seq, "and by a load only");
        always(!(node->has_key && !was.has_key) || (LOADS && node->flash.key_seq > was.flash.key_seq),
               "a key comes by a load with a higher number only");
        always(!(node->has_key && !was.has_key) || !was.was_keyed || RESETS, "and once in a power-up");
        always(!was.flash.has_master || node->flash.robot_id == was.flash.robot_id, "a robot keeps its id");
        always(!was.flash.has_master || node->flash.sealed == was.flash.sealed, "and its radio is sealed or not for good");
    }
    always(!(FORWARDS || MACS) || (was.has_key && !was.safe) || got.result < 0, "without a key nothing is forwarded or made");
    always(!(FORWARDS && got.result < 0) || entry[at] == old, "what is refused is not written");
    always(!FORWARDS || got.result < 0 || (uint32_t)got.result + (CALL == SEALED_RECV ? PHX_SEAL_BYTES : 0) == PHX_ENTRY_HEADER_BYTES + w.len + MORE,
           "an entry has its length");
    for (unsigned i = 0; SEALED && i < PHX_SOURCES; i++) {
        always(got.result >= 0 || same_source(&seals.sources[i], &seals_before.sources[i]), "what is refused was never heard");
        for (unsigned j = 0; j <= i; j++)
            always(sound_source(&seals, now, i, j), "senders: none twice, none of the future");
    }
    if (CALL == SEALED_SEND) {
        always(got.result >= 0 ? seals.t > seals_before.t : seals.t == seals_before.t, "no two seals have the same time");
        always(got.result < 0 || (seals.t >= now && (uint64_t)seals.t <= (uint64_t)now + PHX_SEAL_AHEAD_MS), "nor one far ahead");
    }
    if (CALL == SEALED_RECV && got.result >= 0) {
        always(chance.right, "only what an a-node of the mission sealed is taken");
        got = call(&a, &s, &seals, &w, entry);
        always(got.result < 0, "and once");
        got.result = 0;
    }
    always(!(MACS && got.result < 0) || got.out[PHX_TREQ_OUT_BYTES - 1u] == 0, "what is refused has no MAC");
    if (CALL == CHECK) {
        always(got.result == node->safe, "check says whether it is Safe Mode");
        always(got.result || !was.was_keyed || now - before.keyed_at_ms < was.flash.limits.t_val_ms ||
                   good_tokens(&before, now) > was.flash.limits.f_max,
               "who lives on has f_max + 1 good tokens of different auditors, or is in its grace");
        always(!got.result || was.safe || now == UINT32_MAX || good_tokens(&before, now) <= was.flash.limits.f_max,
               "who has f_max + 1 good tokens lives on");
    }
    if (CALL == INSTALL_TOKEN)
        always(got.result < 0 || (w.t <= now && w.id != 0 && chance.right), "only what is right and of the past is kept");
    if (CALL == ISSUE_TOKEN)
        always(got.result < 0 || w.id != was.flash.robot_id, "nobody audits itself");
    always(!REACHED, "reached");
}

/* Two nodes that differ in their keys alone answer alike: so a key leaves a node by its MACs only. */
void prove_secret(void)
{
    phx_anode a, a2;
    phx_snode s, s2;
    phx_seals seals, seals2;
    words w;
    answer got, got2;
    uint32_t at;
    uint8_t *entry, *entry2;
    phx_mac_key other_key;
    uint8_t other_master[PHX_KEY_BYTES];

    anything();
    given(!RESETS);
    if (OF_SNODE)
        given(sound_node(&s.node));
    else
        given_sound(&a, w.now);
    w.packet = malloc(w.len <= PHX_PACKET_MAX ? w.len : 0);
    entry = malloc(PHX_ENTRY_HEADER_BYTES + (w.len <= PHX_PACKET_MAX ? w.len + MORE : 0));
    entry2 = malloc(PHX_ENTRY_HEADER_BYTES + (w.len <= PHX_PACKET_MAX ? w.len + MORE : 0));
    given(w.packet && entry && entry2 && at < PHX_ENTRY_HEADER_BYTES + (w.len <= PHX_PACKET_MAX ? w.len : 0));
    given(entry[at] == entry2[at]);
    a2 = a;
    s2 = s;
    seals2 = seals;
    for (unsigned i = 0; SEALED && i < PHX_SOURCES; i++)
        given(sound_source(&seals, w.now, i, i));
    a2.node.key = s2.node.key = other_key;
    for (unsigned i = 0; i < PHX_KEY_BYTES; i++)
        a2.node.flash.master[i] = s2.node.flash.master[i] = other_master[i];
    got = call(&a, &s, &seals, &w, entry);
    got2 = call(&a2, &s2, &seals2, &w, entry2);
    always(got.result == got2.result, "keys: no result depends on one");
    always(entry[at] == entry2[at], "keys: no entry depends on one");
    for (unsigned i = 0; i < PHX_TREQ_OUT_BYTES; i++)
        always(got.out[i] == got2.out[i], "keys: no answer depends on one but by a MAC");
    always(!REACHED, "reached");
}
