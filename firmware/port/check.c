/* Host only: runs the vectors that firmware/vectors.py prints, from stdin. Every byte string gets memory of exactly its
   own length, so that the sanitizers see a byte read or written too far. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "phx_seal.h"
#include "profile.h"

#define ROBOTS 4
#define TEXT 8200 /* of a hexadecimal word */

static phx_snode *snodes;
static phx_anode *anodes;
static phx_seals *seals;
static unsigned line, failures;

static void fail(const char *what, long got, long wanted)
{
    printf("line %u: %s: %ld instead of %ld\n", line, what, got, wanted);
    failures++;
}

static void stop(const char *what)
{
    printf("line %u: %s\n", line, what);
    exit(2);
}

static uint32_t read_number(void)
{
    long long value;

    if (scanf("%lld", &value) != 1)
        stop("no number");
    return (uint32_t)value;
}

static uint8_t *read_bytes(uint32_t *len)
{
    static char word[TEXT];
    uint8_t *bytes;

    if (scanf("%8199s", word) != 1)
        stop("no bytes");
    *len = word[0] == '-' ? 0 : (uint32_t)(strlen(word) / 2u);
    bytes = malloc(*len ? *len : 1u);
    if (!bytes)
        stop("no memory");
    for (uint32_t i = 0; i < *len; i++) {
        unsigned byte;
        if (sscanf(word + 2u * i, "%2x", &byte) != 1)
            stop("not hexadecimal");
        bytes[i] = (uint8_t)byte;
    }
    return bytes;
}

static uint8_t *room(uint32_t len)
{
    uint8_t *bytes = calloc(len ? len : 1u, 1);

    if (!bytes)
        stop("no memory");
    return bytes;
}

static void compare(const char *what, const uint8_t *got, const uint8_t *wanted, uint32_t len)
{
    for (uint32_t i = 0; i < len; i++) {
        if (got[i] != wanted[i]) {
            fail(what, got[i], wanted[i]);
            return;
        }
    }
}

static void check_present(void)
{
    uint32_t len;
    uint8_t *key = read_bytes(&len), *plain = read_bytes(&len), *wanted = read_bytes(&len), cipher[8];

    if (phx_present80(key, plain, cipher))
        fail("present", 1, 0);
    compare("present", cipher, wanted, 8);
    free(key);
    free(plain);
    free(wanted);
}

static void check_sha1(void)
{
    uint32_t times = read_number(), len, wanted_len;
    uint8_t *piece = read_bytes(&len), *wanted = read_bytes(&wanted_len), digest[PHX_HASH_BYTES];
    uint8_t *message = room(times * len);

    for (uint32_t i = 0; i < times; i++)
        memcpy(message + i * len, piece, len);
    if (phx_sha1(message, times * len, digest))
        fail("sha1", 1, 0);
    compare("sha1", digest, wanted, wanted_len);
    free(piece);
    free(wanted);
    free(message);
}

static void check_lightmac(void)
{
    int code = (int)read_number(), got;
    uint32_t len, key_len, wanted_len;
    uint8_t *key = read_bytes(&key_len), *message = read_bytes(&len), *wanted = read_bytes(&wanted_len), mac[8] = {0};

    got = phx_lightmac(key, message, len, mac);
    if (got != code)
        fail("lightmac", got, code);
    compare("lightmac", mac, wanted, wanted_len);
    free(key);
    free(message);
    free(wanted);
}

static phx_limits read_limits(void)
{
    uint32_t numbers[sizeof(phx_limits) / sizeof(uint32_t)];
    phx_limits limits;

    for (unsigned i = 0; i < sizeof numbers / sizeof *numbers; i++)
        numbers[i] = read_number();
    memcpy(&limits, numbers, sizeof limits);
    return limits;
}

static void make(void)
{
    phx_limits limits = read_limits();

    for (unsigned i = 0; i < ROBOTS; i++) {
        if (phx_snode_make(snodes + i, &limits) || phx_anode_make(anodes + i, &limits))
            stop("these limits are refused");
    }
    memset(seals, 0, ROBOTS * sizeof *seals);
}

/* No node is made with these, and a node that is there keeps what it has. */
static void refuse(void)
{
    phx_limits limits = read_limits();
    phx_snode s = *snodes;
    phx_anode a = *anodes;

    if (phx_snode_make(snodes, &limits) != PHX_E_ARG || phx_anode_make(anodes, &limits) != PHX_E_ARG)
        fail("limits", 0, PHX_E_ARG);
    compare("s-node", (const uint8_t *)snodes, (const uint8_t *)&s, sizeof s);
    compare("a-node", (const uint8_t *)anodes, (const uint8_t *)&a, sizeof a);
}

/* One call: numbers n, byte strings b; entries have room for exactly what is forwarded, none if it is too long. */
static int call(const char *name, uint32_t robot, const uint32_t n[3], uint8_t *b[3], uint32_t len, uint8_t *out)
{
    phx_snode *s = snodes + robot;
    phx_anode *a = anodes + robot;

#define IS(word) (strcmp(name, word) == 0)
    if (IS("snode_load_master"))
        return phx_snode_load_master(s, b[0], (uint16_t)n[0]);
    if (IS("anode_load_master"))
        return phx_anode_load_master(a, b[0], (uint16_t)n[0]);
    if (IS("snode_load_mission"))
        return phx_snode_load_mission(s, n[0], b[0], b[1], n[1], b[2]);
    if (IS("anode_load_mission"))
        return phx_anode_load_mission(a, n[0], b[0], b[1], n[1], b[2]);
    if (IS("snode_power_up")) {
        phx_snode_power_up(s);
        return 0;
    }
    if (IS("anode_power_up")) {
        phx_anode_power_up(a);
        memset(seals + robot, 0, sizeof *seals);
        return 0;
    }
    if (IS("snode_poll"))
        return phx_snode_poll(s, n[0], b[0], len, out);
    if (IS("anode_recv"))
        return phx_anode_recv(a, n[0], b[0], len, out);
    if (IS("anode_send"))
        return phx_anode_send(a, n[0], b[0], len, out);
    if (IS("make_sealed")) {
        int error = SEALED_MAKE(a);
        if (error > 0)
            fail(name, error, 0);
        return error ? error : a->node.flash.sealed;
    }
    if (IS("sealed_send"))
        return SEALED_SEND(seals + robot, a, n[0], b[0], len, out);
    if (IS("sealed_recv"))
        return SEALED_RECV(seals + robot, a, n[0], b[0], len, out);
    if (IS("anode_actuate"))
        return phx_anode_actuate(a, n[0], b[0], len, out);
    if (IS("snode_make_auth"))
        return phx_snode_make_auth(s, b[0], out);
    if (IS("snode_check_auth"))
        return phx_snode_check_auth(s, b[0], (uint16_t)n[0], b[1], b[2]);
    if (IS("anode_make_auth"))
        return MAKE_AUTH_A(a, out);
    if (IS("snode_check_auth_a"))
        return CHECK_AUTH_A(s, b[0], (uint16_t)n[0], b[1]);
    if (IS("anode_token_request"))
        return phx_anode_token_request(a, n[0], (uint16_t)n[1], out);
    if (IS("anode_issue_token"))
        return phx_anode_issue_token(a, (uint16_t)n[0], n[1], b[0], b[1], b[2], out);
    if (IS("anode_check_token"))
        return phx_anode_check_token(a, (uint16_t)n[0], (uint16_t)n[1], n[2], b[0], b[1]);
    if (IS("anode_install_token"))
        return phx_anode_install_token(a, n[0], (uint16_t)n[1], n[2], b[0], b[1]);
    if (IS("anode_check"))
        return phx_anode_check(a, n[0]);
    if (IS("anode_is_safe"))
        return phx_anode_is_safe(a);
    stop(name);
    return 0;
}

static void check_call(const char *name)
{
    uint32_t robot = read_number(), n[3], len[3], out_len, size;
    int code = (int)read_number(), got;
    uint8_t *b[3], *wanted, *out;

    for (unsigned i = 0; i < 3u; i++)
        n[i] = read_number();
    for (unsigned i = 0; i < 3u; i++)
        b[i] = read_bytes(len + i);
    wanted = read_bytes(&out_len);
    size = out_len ? out_len : (len[0] <= PHX_PACKET_MAX ? PHX_ENTRY_HEADER_BYTES + len[0] : 0);
    out = room(size);
    memset(out, 0xEE, size);
    got = call(name, robot, n, b, len[0], out);
    if (code >= 0 && (IS("snode_poll") || IS("anode_recv") || IS("anode_send") || IS("anode_actuate") ||
                      strncmp(name, "sealed_", 7) == 0))
        code = (int)out_len;
    if (got != code)
        fail(name, got, code);
    compare(name, out, wanted, out_len);
    for (unsigned i = 0; i < 3u; i++)
        free(b[i]);
    free(wanted);
    free(out);
}

int main(void)
{
    char name[32];

    snodes = malloc(ROBOTS * sizeof *snodes);
    anodes = malloc(ROBOTS * sizeof *anodes);
    seals = malloc(ROBOTS * sizeof *seals);
    if (!snodes || !anodes || !seals)
        stop("no memory");
    for (line = 1; scanf("%31s", name) == 1; line++) {
        if (IS("present"))
            check_present();
        else if (IS("sha1"))
            check_sha1();
        else if (IS("lightmac"))
            check_lightmac();
        else if (IS("make"))
            make();
        else if (IS("refused"))
            refuse();
        else
            check_call(name);
    }
    free(snodes);
    free(anodes);
    free(seals);
    printf("%s: %u lines of vectors, %u failures\n", PROFILE, line - 1u, failures);
    return failures > 0 || line < 100u;
}
