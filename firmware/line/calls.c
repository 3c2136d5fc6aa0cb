/* What a call asks of the two nodes, and its answer. All that is the c-node's is measured here before a node sees it. */
#include <string.h>

#include "internal.h"
#include "phx_line.h"

#define LIMITS (sizeof(phx_limits) / sizeof(uint32_t))

typedef struct {
    const uint8_t *call;
    uint32_t len;
    uint8_t *result;
    uint32_t made; /* bytes of the result */
    uint32_t now;
    uint32_t todo;
} work;

static uint16_t get16(const uint8_t *at)
{
    return (uint16_t)(at[0] | at[1] << 8);
}

/* Bytes of a call without what it leaves open; 0 if there is none of this tag. */
static uint32_t size_of(uint8_t tag)
{
    static const uint8_t sizes[] = {
        PHX_CALL_HELLO_BYTES,         PHX_CALL_LIMITS_BYTES,      PHX_CALL_LOAD_MASTER_BYTES,
        PHX_CALL_LOAD_MISSION_BYTES,  PHX_CALL_CLOCK_BYTES,       PHX_CALL_POLL_BYTES,
        PHX_CALL_RECV_BYTES,          PHX_CALL_SEND_BYTES,        PHX_CALL_ACTUATE_BYTES,
        PHX_CALL_MAKE_AUTH_BYTES,     PHX_CALL_CHECK_AUTH_BYTES,  PHX_CALL_TOKEN_REQUEST_BYTES,
        PHX_CALL_ISSUE_TOKEN_BYTES,   PHX_CALL_CHECK_TOKEN_BYTES, PHX_CALL_INSTALL_TOKEN_BYTES,
        PHX_CALL_CHECK_BYTES,         PHX_CALL_SEAL_BYTES,
    };

    return tag >= PHX_CALL_HELLO && tag < PHX_CALL_HELLO + sizeof sizes ? sizes[tag - PHX_CALL_HELLO] : 0;
}

static int is_open(uint8_t tag)
{
    return tag >= PHX_CALL_POLL && tag <= PHX_CALL_ACTUATE;
}

static int hello(phx_line *line, const phx_anode *a, work *w, uint8_t told)
{
    uint8_t *about = w->result;

    line->greeted = w->call[PHX_CALL_HELLO_VERSION] == PHX_LINE_VERSION;
    about[PHX_ABOUT_VERSION] = PHX_LINE_VERSION;
    about[PHX_ABOUT_TOLD] = (uint8_t)(told | (a->node.flash.sealed ? PHX_LINE_SEALED : 0));
    phx_put16(about + PHX_ABOUT_ID, a->node.flash.robot_id);
    phx_put32(about + PHX_ABOUT_SEQ, a->node.flash.key_seq);
    w->made = PHX_ABOUT_BYTES;
    return 0;
}

static int limits(phx_snode *s, phx_anode *a, work *w)
{
    uint32_t numbers[LIMITS];
    phx_limits made;
    int error;

    if (a->node.flash.has_master || a->node.flash.sealed)
        return PHX_E_SEQ;
    for (unsigned i = 0; i < LIMITS; i++)
        numbers[i] = phx_get32(w->call + PHX_CALL_LIMITS_F_MAX + i * sizeof *numbers);
    memcpy(&made, numbers, sizeof made);
    error = phx_snode_make(s, &made);
    if (!error)
        error = phx_anode_make(a, &made);
    if (!error)
        w->todo = PHX_LINE_KEEP;
    return error;
}

static int seal(phx_anode *a, work *w)
{
    int error = phx_sealed_make(a);

    if (!error)
        w->todo = PHX_LINE_KEEP;
    return error;
}

/* Both nodes or neither; a board that was never given limits takes no key. */
static int load_master(phx_snode *s, phx_anode *a, work *w)
{
    const uint8_t *key = w->call + PHX_CALL_LOAD_MASTER_KEY;
    uint16_t id = get16(w->call + PHX_CALL_LOAD_MASTER_ID);
    int error = a->node.flash.limits.batch_size ? phx_snode_load_master(s, key, id) : PHX_E_ARG;

    if (!error)
        error = phx_anode_load_master(a, key, id);
    if (!error)
        w->todo = PHX_LINE_KEEP;
    return error;
}

static int load_mission(phx_snode *s, phx_anode *a, work *w)
{
    const uint8_t *k = w->call + PHX_CALL_LOAD_MISSION_K, *r = w->call + PHX_CALL_LOAD_MISSION_R;
    const uint8_t *mac = w->call + PHX_CALL_LOAD_MISSION_MAC;
    uint32_t seq = phx_get32(w->call + PHX_CALL_LOAD_MISSION_SEQ);
    int error = phx_snode_load_mission(s, w->now, k, r, seq, mac);

    if (!error)
        error = phx_anode_load_mission(a, w->now, k, r, seq, mac);
    if (!error)
        w->todo = PHX_LINE_KEEP;
    return error;
}

static int tell_clock(phx_line *line, work *w, uint8_t told)
{
    uint32_t t = phx_get32(w->call + PHX_CALL_CLOCK_T);

    if (!(told & PHX_LINE_TOLD_CLOCK))
        return PHX_LINE_E_CALL;
    if (t < line->told_ms)
        return PHX_E_ARG;
    line->told_ms = t;
    w->todo = PHX_LINE_CLOCK;
    return 0;
}

/* The four whose result is an entry: as long as what they return. */
static int forwarded(work *w, int size)
{
    w->made = size > 0 ? (uint32_t)size : 0;
    return size;
}

static int made(work *w, int error, uint32_t size)
{
    w->made = error ? 0 : size;
    return error;
}

static int asked(phx_line *line, phx_snode *s, phx_anode *a, phx_seals *seals, work *w, uint8_t told)
{
    const uint8_t *call = w->call, *open = call + PHX_CALL_SEND_BYTES;
    uint32_t len = w->len - PHX_CALL_SEND_BYTES;
    int code, sealed = a->node.flash.sealed;

    switch (call[0]) {
    case PHX_CALL_LIMITS:
        return limits(s, a, w);
    case PHX_CALL_SEAL:
        return seal(a, w);
    case PHX_CALL_LOAD_MASTER:
        return load_master(s, a, w);
    case PHX_CALL_LOAD_MISSION:
        return load_mission(s, a, w);
    case PHX_CALL_CLOCK:
        return tell_clock(line, w, told);
    case PHX_CALL_POLL:
        return forwarded(w, phx_snode_poll(s, w->now, open, len, w->result));
    case PHX_CALL_RECV:
        return forwarded(w, sealed ? phx_sealed_recv(seals, a, w->now, open, len, w->result)
                                   : phx_anode_recv(a, w->now, open, len, w->result));
    case PHX_CALL_SEND:
        return forwarded(w, sealed ? phx_sealed_send(seals, a, w->now, open, len, w->result)
                                   : phx_anode_send(a, w->now, open, len, w->result));
    case PHX_CALL_ACTUATE:
        code = forwarded(w, phx_anode_actuate(a, w->now, open, len, w->result));
        w->todo = code > 0 ? PHX_LINE_ACTUATE : 0;
        return code;
    case PHX_CALL_MAKE_AUTH:
        return made(w, phx_snode_make_auth(s, call + PHX_CALL_MAKE_AUTH_NONCE, w->result), PHX_AUTH_OUT_BYTES);
    case PHX_CALL_CHECK_AUTH:
        return phx_snode_check_auth(s, call + PHX_CALL_CHECK_AUTH_TOP, get16(call + PHX_CALL_CHECK_AUTH_ID),
                                    call + PHX_CALL_CHECK_AUTH_NONCE, call + PHX_CALL_CHECK_AUTH_MAC);
    case PHX_CALL_TOKEN_REQUEST:
        return made(w, phx_anode_token_request(a, w->now, get16(call + PHX_CALL_TOKEN_REQUEST_AUDITOR), w->result),
                    PHX_TREQ_OUT_BYTES);
    case PHX_CALL_ISSUE_TOKEN:
        return made(w,
                    phx_anode_issue_token(a, get16(call + PHX_CALL_ISSUE_TOKEN_AUDITEE),
                                          phx_get32(call + PHX_CALL_ISSUE_TOKEN_T), call + PHX_CALL_ISSUE_TOKEN_TOP,
                                          call + PHX_CALL_ISSUE_TOKEN_TREQ_MAC, call + PHX_CALL_ISSUE_TOKEN_HCKPT,
                                          w->result),
                    PHX_MAC_BYTES);
    case PHX_CALL_CHECK_TOKEN:
        return phx_anode_check_token(a, get16(call + PHX_CALL_CHECK_TOKEN_AUDITOR),
                    get16(call + PHX_CALL_CHECK_TOKEN_AUDITEE), phx_get32(call + PHX_CALL_CHECK_TOKEN_T),
                    call + PHX_CALL_CHECK_TOKEN_HCKPT, call + PHX_CALL_CHECK_TOKEN_MAC);
    case PHX_CALL_INSTALL_TOKEN:
        return phx_anode_install_token(a, w->now, get16(call + PHX_CALL_INSTALL_TOKEN_AUDITOR),
                                       phx_get32(call + PHX_CALL_INSTALL_TOKEN_T),
                                       call + PHX_CALL_INSTALL_TOKEN_HCKPT, call + PHX_CALL_INSTALL_TOKEN_MAC);
    default: /* PHX_CALL_CHECK: no other tag has a size */
        return phx_anode_check(a, w->now);
    }
}

static int fits(const work *w)
{
    uint32_t size = size_of(w->call[0]);

    return size > 0 && (is_open(w->call[0]) ? w->len >= size : w->len == size);
}

static void answer(phx_line *line, uint16_t number, int code, uint32_t made_bytes)
{
    line->number = number;
    line->out[0] = PHX_ANSWER;
    phx_put16(line->out + PHX_ANSWER_NUMBER, number);
    phx_put32(line->out + PHX_ANSWER_CODE, (uint32_t)code);
    line->out_len = PHX_ANSWER_BYTES + made_bytes;
    phx_put32(line->out + line->out_len, phx_crc32(line->out, line->out_len));
    line->out_len += PHX_LINE_CRC_BYTES;
}

uint32_t phx_line_call(phx_line *line, phx_snode *s, phx_anode *a, phx_seals *seals, uint32_t now, uint8_t told)
{
    work w = {line->in, line->call_len, line->out + PHX_ANSWER_BYTES, 0, now, 0};
    uint16_t number = get16(w.call + PHX_CALL_CHECK_NUMBER);
    int code;

    if (fits(&w) && w.call[0] == PHX_CALL_HELLO)
        code = hello(line, a, &w, told);
    else if (!line->greeted)
        code = PHX_LINE_E_HELLO;
    else if (number == line->number)
        return 0; /* the answer to it got lost, and is still there */
    else
        code = fits(&w) ? asked(line, s, a, seals, &w, told) : PHX_LINE_E_CALL;
    answer(line, number, code, w.made);
    return w.todo;
}

const uint8_t *phx_line_command(const phx_line *line, uint32_t *len)
{
    const uint32_t head = PHX_ANSWER_BYTES + PHX_ENTRY_HEADER_BYTES;

    *len = line->out_len - PHX_LINE_CRC_BYTES - head;
    return line->out + head;
}
