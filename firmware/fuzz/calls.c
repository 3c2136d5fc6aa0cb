/* Any calls, in any order, at any times, of two robots' trusted nodes in one swarm: libFuzzer chooses, ASan and UBSan
   watch memory, and after each call what `proofs/calls.c` calls a sound node is looked for. Whoever only guesses has no
   true MAC, so answers of nodes are kept, and later arguments may be such as they were. `make fuzz`. */
#include <stdlib.h>
#include <string.h>

#include "internal.h"
#include "phx_seal.h"

#define ROBOTS 2u
#define KEPT 8u
#define KEPT_BYTES 32u
#define AIR_BYTES 64u
#define SECRET_BYTES 8u /* so many of a key's bytes in an answer are no chance */

enum { POWER_UP, LOAD_MASTER, LOAD_MISSION, TRUE_MISSION, RECV, SEND, ACTUATE, TOKEN_REQUEST, ISSUE_TOKEN, CHECK_TOKEN,
       INSTALL_TOKEN, CHECK, POLL, MAKE_AUTH, CHECK_AUTH, LATER, MUCH_LATER, CALLS, SEALED_SEND, SEALED_RECV };

static const uint8_t master[PHX_KEY_BYTES] = "a master key of twen";
static const uint8_t mission[PHX_KEY_BYTES] = "of a mission: as man";

/* What is left of the fuzzer's bytes; zeros when there are none. */
typedef struct {
    const uint8_t *at;
    size_t left;
} stream;

typedef struct {
    phx_snode s;
    phx_anode a;
    phx_seals seals;
    uint32_t now;
} robot;

typedef struct {
    robot robots[ROBOTS];
    uint8_t kept[KEPT][KEPT_BYTES];
    unsigned next;
    uint32_t asked_at; /* of the last token request */
    uint8_t air[KEPT][AIR_BYTES];
    uint32_t air_len[KEPT];
    unsigned said;
} world;

static void stop_unless(int holds)
{
    if (!holds)
        abort();
}

static void take(stream *in, void *to, size_t size)
{
    size_t there = size < in->left ? size : in->left;

    memset(to, 0, size);
    if (there)
        memcpy(to, in->at, there);
    in->at += there;
    in->left -= there;
}

static uint32_t number(stream *in, unsigned bytes)
{
    uint8_t raw[4];
    uint32_t value = 0;

    take(in, raw, bytes);
    for (unsigned i = 0; i < bytes; i++)
        value |= (uint32_t)raw[i] << (8u * i);
    return value;
}

/* Where in an answer a hash begins, and a MAC: see PHX_AUTH_OUT_BYTES and PHX_TREQ_OUT_BYTES. */
static const unsigned begins[4] = {0, 4, 22, 24};

/* An argument in memory of just its size, so that a byte too many is seen: the fuzzer's, or from a kept answer. */
static uint8_t *argument(stream *in, const world *w, size_t size)
{
    uint8_t *made = malloc(size), from = (uint8_t)number(in, 1);

    if (from & 0x80u) {
        unsigned at = begins[(from >> 4) % 4u];
        for (size_t i = 0; i < size; i++)
            made[i] = w->kept[from % KEPT][(at + i) % KEPT_BYTES];
    } else {
        take(in, made, size);
    }
    return made;
}

static int has_part_of(const uint8_t *bytes, size_t size, const uint8_t *secret, size_t secret_size)
{
    for (size_t i = 0; i + SECRET_BYTES <= size; i++)
        for (size_t k = 0; k + SECRET_BYTES <= secret_size; k++)
            if (memcmp(bytes + i, secret + k, SECRET_BYTES) == 0)
                return 1;
    return 0;
}

static void keep(world *w, const uint8_t *answer, size_t size)
{
    stop_unless(!has_part_of(answer, size, master, sizeof master) && !has_part_of(answer, size, mission, sizeof mission));
    memset(w->kept[w->next], 0, KEPT_BYTES);
    memcpy(w->kept[w->next], answer, size);
    w->next = (w->next + 1u) % KEPT;
}

static void sound_node(const phx_node *node, const phx_node *was, int reset)
{
    const phx_limits *limits = &node->flash.limits;

    stop_unless(node->batched < limits->batch_size && !(node->safe && node->has_key) && !(node->has_key && !node->was_keyed));
    stop_unless(reset || !was->safe || node->safe);
    stop_unless(node->flash.key_seq >= was->flash.key_seq);
    stop_unless(!(node->has_key && !was->has_key) || node->flash.key_seq > was->flash.key_seq);
}

static void sound(const robot *r)
{
    const phx_limits *limits = &r->a.node.flash.limits;

    stop_unless(r->a.requests.level <= (uint64_t)limits->bucket_capacity * limits->bucket_period_ms);
    stop_unless(r->a.send.level <= (uint64_t)limits->send_capacity_us * 1000u);
    stop_unless(r->a.audit.level <= (uint64_t)limits->audit_capacity_us * 1000u);
    for (unsigned i = 0; i < PHX_TOKENS; i++) {
        stop_unless(r->a.tokens[i].auditor == 0 || (i <= limits->f_max && r->a.tokens[i].t <= r->now));
        for (unsigned k = 0; k < i; k++)
            stop_unless(r->a.tokens[i].auditor == 0 || r->a.tokens[i].auditor != r->a.tokens[k].auditor);
    }
}

/* A mission key as an operator seals it, newer than the robot's last. */
static void load_true_mission(robot *r, uint8_t number_of_it)
{
    uint8_t message[PHX_MKEY_BYTES], salt[2u * PHX_KEY_BYTES], pad[PHX_HASH_BYTES], mac[PHX_MAC_BYTES];
    uint32_t seq = r->a.node.flash.key_seq + number_of_it;

    memset(salt, 7, PHX_KEY_BYTES);
    memcpy(salt + PHX_KEY_BYTES, master, PHX_KEY_BYTES);
    phx_sha1(salt, sizeof salt, pad);
    message[0] = PHX_MKEY;
    for (unsigned i = 0; i < PHX_KEY_BYTES; i++)
        message[PHX_MKEY_K + i] = pad[i] ^ mission[i];
    memcpy(message + PHX_MKEY_R, salt, PHX_KEY_BYTES);
    phx_put32(message + PHX_MKEY_SEQ, seq);
    phx_lightmac(master, message, sizeof message, mac);
    phx_anode_load_mission(&r->a, r->now, message + PHX_MKEY_K, message + PHX_MKEY_R, seq, mac);
    phx_snode_load_mission(&r->s, r->now, message + PHX_MKEY_K, message + PHX_MKEY_R, seq, mac);
}

static void forward(stream *in, robot *r, unsigned call)
{
    uint32_t len = number(in, 2);
    /* What is too long is refused before it is looked at. */
    size_t there = len <= PHX_PACKET_MAX ? len : 0;
    uint8_t *packet = malloc(there ? there : 1u), *entry = malloc(PHX_ENTRY_HEADER_BYTES + there);
    const phx_node *node = call == POLL ? &r->s.node : &r->a.node;
    int could = node->has_key && !node->safe, got;

    take(in, packet, there);
    got = call == RECV   ? phx_anode_recv(&r->a, r->now, packet, len, entry)
          : call == SEND ? phx_anode_send(&r->a, r->now, packet, len, entry)
          : call == POLL ? phx_snode_poll(&r->s, r->now, packet, len, entry)
                         : phx_anode_actuate(&r->a, r->now, packet, len, entry);
    stop_unless(got < 0 || (could && (uint32_t)got == PHX_ENTRY_HEADER_BYTES + len));
    free(packet);
    free(entry);
}

static void seal(stream *in, world *w, robot *r)
{
    uint32_t len = number(in, 1) % (AIR_BYTES - PHX_SEAL_BYTES + 1u), was = r->seals.t;
    uint8_t *packet = malloc(len ? len : 1u), *entry = malloc(PHX_ENTRY_HEADER_BYTES + len + PHX_SEAL_BYTES);
    int could = r->a.node.has_key && !r->a.node.safe, got;

    take(in, packet, len);
    got = phx_sealed_send(&r->seals, &r->a, r->now, packet, len, entry);
    if (got >= 0) {
        uint32_t sealed = len + PHX_SEAL_BYTES;
        stop_unless(could && (uint32_t)got == PHX_ENTRY_HEADER_BYTES + sealed && r->seals.t > was);
        memcpy(w->air[w->said % KEPT], entry + PHX_ENTRY_HEADER_BYTES, sealed);
        w->air_len[w->said++ % KEPT] = sealed;
    }
    free(packet);
    free(entry);
}

/* What is on the air, or with a bit of it turned. */
static void unseal(stream *in, const world *w, robot *r)
{
    uint32_t which = number(in, 1), len = w->air_len[which % KEPT], turned = number(in, 1);
    uint8_t *packet = malloc(len ? len : 1u), *entry = malloc(PHX_ENTRY_HEADER_BYTES + len);
    int alters = len > 0 && which & 0x80u, got;

    memcpy(packet, w->air[which % KEPT], len);
    if (alters)
        packet[turned % len] ^= (uint8_t)(1u << (which >> 4) % 8u);
    got = phx_sealed_recv(&r->seals, &r->a, r->now, packet, len, entry);
    if (got >= 0) {
        stop_unless(!alters && r->a.node.has_key && (uint32_t)got == PHX_ENTRY_HEADER_BYTES + len - PHX_SEAL_BYTES);
        stop_unless(phx_sealed_recv(&r->seals, &r->a, r->now, packet, len, entry) == PHX_E_REPEATED);
    }
    free(packet);
    free(entry);
}

static void ask(stream *in, world *w, robot *r, unsigned call)
{
    uint16_t id = (uint16_t)number(in, 1), auditee = (uint16_t)(call == CHECK_TOKEN ? number(in, 1) : 0);
    uint32_t t = number(in, 1) & 1u ? w->asked_at : number(in, 4);
    uint8_t *one = argument(in, w, PHX_HASH_BYTES), *two = argument(in, w, PHX_HASH_BYTES);
    uint8_t *mac = argument(in, w, PHX_MAC_BYTES), *out = calloc(1, PHX_TREQ_OUT_BYTES);
    int had_key = r->a.node.has_key, got = 0;

    switch (call) {
    case LOAD_MASTER:
        phx_anode_load_master(&r->a, one, id);
        break;
    case LOAD_MISSION:
        phx_anode_load_mission(&r->a, r->now, one, two, t, mac);
        phx_snode_load_mission(&r->s, r->now, one, two, t, mac);
        break;
    case TOKEN_REQUEST:
        got = phx_anode_token_request(&r->a, r->now, id, out);
        break;
    case ISSUE_TOKEN:
        got = phx_anode_issue_token(&r->a, id, t, one, mac, two, out);
        break;
    case CHECK_TOKEN:
        phx_anode_check_token(&r->a, id, auditee, t, two, mac);
        break;
    case INSTALL_TOKEN:
        phx_anode_install_token(&r->a, r->now, id, t, two, mac);
        break;
    case MAKE_AUTH:
        had_key = r->s.node.has_key;
        got = phx_snode_make_auth(&r->s, mac, out);
        break;
    case CHECK_AUTH:
        phx_snode_check_auth(&r->s, one, id, two, mac);
        break;
    default:
        break;
    }
    if (got >= 0 && (call == TOKEN_REQUEST || call == ISSUE_TOKEN || call == MAKE_AUTH)) {
        stop_unless(had_key);
        if (call == TOKEN_REQUEST)
            w->asked_at = r->now;
        keep(w, out, PHX_TREQ_OUT_BYTES);
    }
    free(one);
    free(two);
    free(mac);
    free(out);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    stream in = {data, size};
    world w;
    phx_limits limits = {1, 1000, 3, 2, 100, 200, 5000, 200, 5000, 100, 1333, 300};

    memset(&w, 0, sizeof w);
    limits.f_max = number(&in, 1) % (PHX_F_MAX + 2u);
    for (unsigned i = 0; i < ROBOTS; i++) {
        if (phx_anode_make(&w.robots[i].a, &limits) || phx_snode_make(&w.robots[i].s, &limits))
            return 0;
        phx_anode_load_master(&w.robots[i].a, master, (uint16_t)(i + 1u));
        phx_snode_load_master(&w.robots[i].s, master, (uint16_t)(i + 1u));
    }
    while (in.left > 0) {
        uint8_t what = (uint8_t)number(&in, 1);
        robot *r = &w.robots[what >> 7];
        unsigned call = (what & 0x7fu) % CALLS;
        if ((what & 0x7eu) == 0x7eu) /* so that what was found before means what it did */
            call = what & 1u ? SEALED_SEND : SEALED_RECV;
        phx_node a_was = r->a.node, s_was = r->s.node;
        if (call == POWER_UP) {
            phx_anode_power_up(&r->a);
            phx_snode_power_up(&r->s);
            memset(&r->seals, 0, sizeof r->seals);
            r->now = 0;
        } else if (call == TRUE_MISSION) {
            load_true_mission(r, (uint8_t)number(&in, 1));
        } else if (call == LATER || call == MUCH_LATER) {
            uint32_t more = number(&in, call == LATER ? 1 : 4);
            r->now = more > UINT32_MAX - r->now ? UINT32_MAX : r->now + more;
        } else if (call == CHECK) {
            stop_unless(phx_anode_check(&r->a, r->now) == phx_anode_is_safe(&r->a));
            stop_unless(r->now != UINT32_MAX || r->a.node.safe);
        } else if (call == SEALED_SEND) {
            seal(&in, &w, r);
        } else if (call == SEALED_RECV) {
            unseal(&in, &w, r);
        } else if (call == RECV || call == SEND || call == ACTUATE || call == POLL) {
            forward(&in, r, call);
        } else {
            ask(&in, &w, r, call);
        }
        sound_node(&r->a.node, &a_was, call == POWER_UP);
        sound_node(&r->s.node, &s_was, call == POWER_UP);
        sound(r);
    }
    return 0;
}
