/* Any bytes on the serial line between true frames with any calls: libFuzzer chooses, ASan and UBSan watch memory. Whatever
   came before, a true frame is taken, whole and unchanged, and its answer comes out whole. `make fuzz`. */
#include <stdlib.h>
#include <string.h>

#include "phx_line.h"

static void stop_unless(int holds)
{
    if (!holds)
        abort();
}

/* All bytes of what is in `from->out`, mark to mark, as `to` takes them; whether a frame was whole at its end. */
static int passes(phx_line *from, phx_line *to)
{
    uint8_t byte;
    int whole = 0;
    uint32_t most = PHX_LINE_OUT_MAX + PHX_LINE_OUT_MAX / PHX_LINE_RUN_MAX + 4u, count = 0;

    phx_line_say(from);
    while (phx_line_next(from, &byte)) {
        stop_unless(++count <= most && (byte != PHX_LINE_MARK || count == 1 || !whole));
        whole = phx_line_byte(to, byte);
        stop_unless(!whole || byte == PHX_LINE_MARK);
        if (count == 1)
            whole = 0; /* what was under way ends with this mark, whatever it was */
    }
    return whole;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    phx_line *board = calloc(1, sizeof *board), *other = calloc(1, sizeof *other), *heard = calloc(1, sizeof *heard);
    phx_snode *s = calloc(1, sizeof *s);
    phx_anode *a = calloc(1, sizeof *a);
    phx_seals *seals = calloc(1, sizeof *seals);
    uint32_t now = 0, crc;

    while (size >= 3) {
        uint32_t len = data[1] | (uint32_t)(data[2] & 15u) << 8, later = data[2] >> 4;
        uint8_t what = data[0];
        data += 3;
        size -= 3;
        len = len < size ? len : (uint32_t)size;
        now = now > UINT32_MAX - later * later ? UINT32_MAX : now + later * later;
        if (what & 1u || len < PHX_CALL_CHECK_BYTES || len + PHX_LINE_CRC_BYTES > PHX_LINE_IN_MAX) {
            for (uint32_t i = 0; i < len; i++)
                if (phx_line_byte(board, data[i]))
                    phx_line_call(board, s, a, seals, now, (uint8_t)(what >> 1));
        } else {
            memcpy(other->out, data, len);
            crc = phx_crc32(data, len);
            for (unsigned i = 0; i < PHX_LINE_CRC_BYTES; i++)
                other->out[len + i] = (uint8_t)(crc >> (8u * i));
            other->out_len = len + PHX_LINE_CRC_BYTES;
            stop_unless(passes(other, board));
            stop_unless(board->call_len == len && memcmp(board->in, data, len) == 0);
            phx_line_call(board, s, a, seals, now, (uint8_t)(what >> 1));
            stop_unless(board->out_len <= PHX_LINE_OUT_MAX);
            if (board->out_len > 0 && board->out_len <= PHX_LINE_IN_MAX) {
                stop_unless(passes(board, heard));
                stop_unless(memcmp(heard->in, board->out, board->out_len) == 0);
            }
        }
        data += len;
        size -= len;
    }
    free(board);
    free(other);
    free(heard);
    free(s);
    free(a);
    free(seals);
    return 0;
}
