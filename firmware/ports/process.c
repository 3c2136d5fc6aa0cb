/* The port for a process, to try things with: `node FLASH_FILE [told]`, its line on descriptor 0. Whoever runs as the same
   user reads its keys, so it protects from nobody. With `told` the line tells it the time. */
#define _POSIX_C_SOURCE 200809L
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "phx_port.h"

#define SLOT_BYTES 512
#define TURN_MS 5

static int flash;
static uint8_t told = PHX_LINE_TOLD_READINGS;
static uint32_t told_ms;
static struct timespec began;

uint32_t phx_port_now(void)
{
    struct timespec now;
    long long ms;

    if (told & PHX_LINE_TOLD_CLOCK)
        return told_ms;
    clock_gettime(CLOCK_MONOTONIC, &now);
    ms = (now.tv_sec - began.tv_sec) * 1000LL + (now.tv_nsec - began.tv_nsec) / 1000000L;
    return ms < UINT32_MAX ? (uint32_t)ms : UINT32_MAX;
}

uint8_t phx_port_told(void)
{
    return told;
}

void phx_port_set_clock(uint32_t now)
{
    told_ms = now;
}

static int ready(short events)
{
    struct pollfd line = {0, events, 0};

    return poll(&line, 1, TURN_MS) > 0;
}

/* A system call a byte would take as long as the node: what is put goes out together, before more is waited for. */
static uint8_t waiting[PHX_LINE_OUT_MAX];
static size_t n_waiting;

static void send_waiting(void)
{
    ssize_t sent = ready(POLLOUT) ? write(0, waiting, n_waiting) : 0;

    if (sent < 0)
        _exit(0); /* nobody is there any more */
    n_waiting -= (size_t)sent;
    memmove(waiting, waiting + sent, n_waiting);
}

int phx_port_put(uint8_t byte)
{
    if (n_waiting == sizeof waiting)
        send_waiting();
    if (n_waiting == sizeof waiting)
        return 0;
    waiting[n_waiting++] = byte;
    return 1;
}

int phx_port_get(uint8_t *byte)
{
    static uint8_t came[4096];
    static ssize_t at, end;

    if (at == end) {
        if (n_waiting > 0)
            send_waiting();
        if (n_waiting > 0 || !ready(POLLIN))
            return 0;
        at = 0;
        end = read(0, came, sizeof came);
        if (end <= 0)
            _exit(0);
    }
    *byte = came[at++];
    return 1;
}

int phx_port_flash_write(uint32_t slot, const uint8_t *data, uint32_t len)
{
    return pwrite(flash, data, len, (off_t)slot * SLOT_BYTES) == (ssize_t)len && fsync(flash) == 0 ? 0 : -1;
}

void phx_port_flash_read(uint32_t slot, uint8_t *data, uint32_t len)
{
    memset(data, 0, len);
    if (pread(flash, data, len, (off_t)slot * SLOT_BYTES) < 0)
        phx_port_halt();
}

void phx_port_actuate(const uint8_t *command, uint32_t len)
{
    (void)command; /* nothing hangs on it */
    (void)len;
}

uint32_t phx_port_sense(uint8_t *reading)
{
    (void)reading;
    return 0;
}

void phx_port_halt(void)
{
    _exit(1);
}

int main(int argc, char **argv)
{
    if (argc < 2 || argc > 3) {
        fprintf(stderr, "usage: node FLASH_FILE [told]\n");
        return 2;
    }
    if (argc == 3)
        told |= PHX_LINE_TOLD_CLOCK;
    flash = open(argv[1], O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    if (flash < 0) {
        fprintf(stderr, "node: %s: %s\n", argv[1], strerror(errno));
        return 1;
    }
    clock_gettime(CLOCK_MONOTONIC, &began);
    phx_serve();
    return 0;
}
