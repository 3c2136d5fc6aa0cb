/* Frames: a mark, the payload and its CRC without zeros (COBS), a mark. Whatever stands between two marks is a frame or
   is dropped, so that rubbish costs the frame it hits and no other. */
#include "internal.h"
#include "phx_line.h"

/* Of CRC-32, reflected: four bits at a time. */
static const uint32_t nibbles[16] = {
    0x00000000u, 0x1db71064u, 0x3b6e20c8u, 0x26d930acu, 0x76dc4190u, 0x6b6b51f4u, 0x4db26158u, 0x5005713cu,
    0xedb88320u, 0xf00f9344u, 0xd6d6a3e8u, 0xcb61b38cu, 0x9b64c2b0u, 0x86d3d2d4u, 0xa00ae278u, 0xbdbdf21cu,
};

uint32_t phx_crc32(const uint8_t *data, uint32_t len)
{
    uint32_t crc = 0xffffffffu;

    for (uint32_t i = 0; i < len; i++) {
        crc ^= data[i];
        crc = crc >> 4 ^ nibbles[crc & 15u];
        crc = crc >> 4 ^ nibbles[crc & 15u];
    }
    return ~crc;
}

uint32_t phx_get32(const uint8_t *at)
{
    return at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16 | (uint32_t)at[3] << 24;
}

static void begin(phx_line *line)
{
    line->len = line->left = line->gap = line->lost = 0;
}

static void append(phx_line *line, uint8_t byte)
{
    if (line->len == PHX_LINE_IN_MAX)
        line->lost = 1;
    else
        line->in[line->len++] = byte;
}

static int is_whole(const phx_line *line)
{
    uint32_t end = line->len - PHX_LINE_CRC_BYTES;

    return !line->lost && line->left == 0 && line->len >= PHX_CALL_CHECK_BYTES + PHX_LINE_CRC_BYTES &&
           phx_crc32(line->in, end) == phx_get32(line->in + end);
}

int phx_line_byte(phx_line *line, uint8_t byte)
{
    int whole = 0;

    if (byte == PHX_LINE_MARK) {
        whole = is_whole(line);
        line->call_len = line->len - PHX_LINE_CRC_BYTES;
        begin(line);
    } else if (line->left > 0) {
        append(line, byte);
        line->left--;
    } else {
        if (line->gap)
            append(line, PHX_LINE_MARK);
        line->gap = byte <= PHX_LINE_RUN_MAX;
        line->left = (uint8_t)(byte - 1u);
    }
    return whole;
}

enum { DONE, OPEN, LENGTH, RUN, CLOSE };

/* The bytes until the next zero, the end, or as many as a length can say. */
static uint8_t run_of(const phx_line *line)
{
    uint32_t n = 0;

    while (n < PHX_LINE_RUN_MAX && line->out_at + n < line->out_len && line->out[line->out_at + n] != PHX_LINE_MARK)
        n++;
    return (uint8_t)n;
}

static uint8_t after_run(phx_line *line)
{
    if (line->out_at == line->out_len)
        return CLOSE;
    if (!line->full)
        line->out_at++;
    return LENGTH;
}

void phx_line_say(phx_line *line)
{
    line->out_at = 0;
    line->stage = OPEN;
}

int phx_line_next(phx_line *line, uint8_t *byte)
{
    uint8_t stage = line->stage;

    *byte = PHX_LINE_MARK;
    if (stage == DONE)
        return 0;
    if (stage == OPEN) {
        line->stage = LENGTH;
    } else if (stage == CLOSE) {
        line->stage = DONE;
    } else if (stage == LENGTH) {
        line->run = run_of(line);
        line->full = line->run == PHX_LINE_RUN_MAX;
        *byte = (uint8_t)(line->run + 1u);
        line->stage = line->run > 0 ? RUN : after_run(line);
    } else {
        *byte = line->out[line->out_at++];
        if (--line->run == 0)
            line->stage = after_run(line);
    }
    return 1;
}
