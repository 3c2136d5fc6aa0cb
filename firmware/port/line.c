/* Host only: frames as vectors/serial.json has them (firmware/vectors.py serial), and power that fails at every byte that
   is kept. The port is this file: a line of memory, a flash that stops in the middle of a write. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "phx_port.h"

#define SLOT_BYTES 512u
#define TEXT 20000
#define MISSIONS 3u

static uint8_t flash[PHX_FLASH_SLOTS][SLOT_BYTES];
static uint32_t power; /* bytes that can still be written */
static int dead;
static const uint8_t *coming;
static uint32_t n_coming, came, n_gone;
static uint8_t gone[2 * PHX_LINE_OUT_MAX];
static unsigned failures;

uint32_t phx_port_now(void)
{
    return 0;
}

uint8_t phx_port_told(void)
{
    return PHX_LINE_TOLD_READINGS;
}

void phx_port_set_clock(uint32_t now)
{
    (void)now;
}

int phx_port_get(uint8_t *byte)
{
    if (dead || came == n_coming)
        return 0;
    *byte = coming[came++];
    return 1;
}

int phx_port_put(uint8_t byte)
{
    if (!dead && n_gone < sizeof gone)
        gone[n_gone++] = byte;
    return 1;
}

/* Erasing counts as a byte. */
int phx_port_flash_write(uint32_t slot, const uint8_t *data, uint32_t len)
{
    if (dead || power == 0)
        return -1;
    memset(flash[slot], 0xff, SLOT_BYTES);
    power--;
    for (uint32_t i = 0; i < len; i++) {
        if (power == 0)
            return -1;
        flash[slot][i] = data[i];
        power--;
    }
    return 0;
}

void phx_port_flash_read(uint32_t slot, uint8_t *data, uint32_t len)
{
    memcpy(data, flash[slot], len);
}

void phx_port_actuate(const uint8_t *command, uint32_t len)
{
    (void)command;
    (void)len;
}

uint32_t phx_port_sense(uint8_t *reading)
{
    (void)reading;
    return 0;
}

void phx_port_halt(void)
{
    dead = 1;
}

static void fail(const char *what, uint32_t at)
{
    if (failures++ < 10)
        printf("%s %u\n", what, at);
}

static uint32_t read_bytes(uint8_t *bytes)
{
    static char word[TEXT];
    unsigned byte;

    if (scanf("%19999s", word) != 1)
        exit(2);
    for (uint32_t i = 0; word[0] != '-' && word[2 * i]; i++) {
        if (sscanf(word + 2 * i, "%2x", &byte) != 1)
            exit(2);
        bytes[i] = (uint8_t)byte;
    }
    return word[0] == '-' ? 0 : (uint32_t)strlen(word) / 2u;
}

/* What a payload looks like on the line. */
static void say(phx_line *line, const uint8_t *payload, uint32_t len)
{
    uint8_t byte;
    uint32_t crc = phx_crc32(payload, len);

    memcpy(line->out, payload, len);
    for (unsigned i = 0; i < PHX_LINE_CRC_BYTES; i++)
        line->out[len + i] = (uint8_t)(crc >> 8 * i);
    line->out_len = len + PHX_LINE_CRC_BYTES;
    n_gone = 0;
    phx_line_say(line);
    while (phx_line_next(line, &byte))
        phx_port_put(byte);
}

/* A line is: the stream, how many payloads, each; and the frame of the first if the stream is just that. */
static unsigned frames(void)
{
    static uint8_t stream[TEXT / 2], payload[TEXT / 2];
    static phx_line line;
    unsigned lines = 0, wanted;
    uint32_t len, at, n;

    while (scanf("%u", &wanted) == 1) {
        memset(&line, 0, sizeof line);
        len = read_bytes(stream);
        at = 0;
        lines++;
        for (unsigned k = 0; k < wanted; k++) {
            n = read_bytes(payload);
            while (at < len && !phx_line_byte(&line, stream[at]))
                at++;
            if (at++ == len || line.call_len != n || memcmp(line.in, payload, n) != 0)
                fail("no such payload in line", lines);
            if (wanted == 1) {
                say(&line, payload, n);
                if (n_gone > len || (n_gone == len && memcmp(gone, stream, len) != 0))
                    fail("another frame in line", lines);
            }
        }
        while (at < len)
            if (phx_line_byte(&line, stream[at++]))
                fail("a payload too many in line", lines);
    }
    return lines;
}

/* One call to the board; the code of its answer, or 1 if there is none. */
static int ask(uint8_t *call, uint32_t len)
{
    static phx_line host;
    static uint8_t frame[sizeof gone];
    static uint8_t number;

    call[PHX_CALL_CHECK_NUMBER] = ++number;
    say(&host, call, len);
    memcpy(frame, gone, n_gone);
    coming = frame;
    n_coming = n_gone;
    came = n_gone = 0;
    for (unsigned i = 0; i <= n_coming; i++)
        phx_serve_once();
    for (uint32_t i = 0; i < n_gone; i++)
        if (phx_line_byte(&host, gone[i]))
            return (int)phx_get32(host.in + PHX_ANSWER_CODE);
    return 1;
}

static void put32(uint8_t *at, uint32_t value)
{
    for (unsigned i = 0; i < 4; i++)
        at[i] = (uint8_t)(value >> 8 * i);
}

static int hello(void)
{
    uint8_t call[PHX_CALL_HELLO_BYTES] = {PHX_CALL_HELLO, 0, 0, PHX_LINE_VERSION};

    return ask(call, sizeof call);
}

static int make(void)
{
    uint8_t call[PHX_CALL_LIMITS_BYTES] = {PHX_CALL_LIMITS};

    for (unsigned at = PHX_CALL_LIMITS_F_MAX; at < PHX_CALL_LIMITS_BYTES; at += 4u)
        put32(call + at, 1);
    return ask(call, sizeof call);
}

static const uint8_t master[PHX_KEY_BYTES] = {1, 2, 3};

static int load_master(void)
{
    uint8_t call[PHX_CALL_LOAD_MASTER_BYTES] = {PHX_CALL_LOAD_MASTER};

    memcpy(call + PHX_CALL_LOAD_MASTER_KEY, master, sizeof master);
    call[PHX_CALL_LOAD_MASTER_ID] = 7;
    return ask(call, sizeof call);
}

static int load_mission(uint32_t seq)
{
    uint8_t call[PHX_CALL_LOAD_MISSION_BYTES] = {PHX_CALL_LOAD_MISSION}, message[PHX_MKEY_BYTES] = {PHX_MKEY};

    put32(call + PHX_CALL_LOAD_MISSION_SEQ, seq);
    put32(message + PHX_MKEY_SEQ, seq);
    phx_lightmac(master, message, sizeof message, call + PHX_CALL_LOAD_MISSION_MAC);
    return ask(call, sizeof call);
}

static void power_up(uint32_t left)
{
    power = left;
    dead = 0;
    phx_robot_power_up();
    hello();
}

/* Power fails `cut` bytes after a board was new, and `again` bytes after it came back. Whatever was answered holds. */
static void life(uint32_t cut, uint32_t again)
{
    uint32_t used = 0;
    int is_made, has_master;

    memset(flash, 0xff, sizeof flash);
    power_up(cut);
    is_made = make() == 0;
    has_master = load_master() == 0;
    for (uint32_t seq = 1; seq <= MISSIONS; seq++) {
        if (load_mission(seq) == 0)
            used = seq;
        power_up(power);
    }
    power_up(again);
    if (load_mission(MISSIONS + 1) == 0)
        used = MISSIONS + 1;
    power_up(UINT32_MAX);
    if (is_made && has_master && make() != PHX_E_SEQ)
        fail("a master key was lost when power failed after bytes", cut);
    make();
    load_master();
    if (used > 0 && load_mission(used) != PHX_E_SEQ)
        fail("a mission number was taken twice when power failed after bytes", cut);
    if (load_mission(MISSIONS + 2) != 0)
        fail("no mission was taken any more when power had failed after bytes", cut);
}

int main(void)
{
    unsigned lines = frames(), lives = 0;
    uint32_t all;

    memset(flash, 0xff, sizeof flash);
    power_up(UINT32_MAX);
    if (make() || load_master() || load_mission(1))
        fail("a board that takes no keys", 0);
    all = UINT32_MAX - power;
    for (uint32_t cut = 0; cut <= all * (2 + MISSIONS) / 3; cut++)
        for (uint32_t again = 0; again <= all / 2; again += 61, lives++)
            life(cut, again);
    printf("serial line: %u lines of vectors, power failed in %u ways, %u failures\n", lines, lives, failures);
    return failures > 0 || lines < 10u;
}
