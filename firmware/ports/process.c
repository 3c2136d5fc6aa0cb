/* The port for a process, to try things with: `node FLASH_FILE [told|WHEELS [PPM,MS]]`, its line on descriptor 0. Whoever runs as the
   same user reads its keys, so it protects from nobody. With `told` the line tells it the time. WHEELS is the path of a Unix
   socket (SEQPACKET) where motors listen: a packet is a command, or one zero byte to stand still, and they stand still too
   when it is closed; - for none. With PPM,MS its clock runs fast by so much, from MS on. */
#define _POSIX_C_SOURCE 200809L
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#include "phx_port.h"

#define SLOT_BYTES 512
#define TURN_MS 5

static int flash;
static int wheels = -1;
static uint8_t told = PHX_LINE_TOLD_READINGS;
static uint32_t told_ms;
static struct timespec began;
static int ppm;
static unsigned ahead_ms;

uint32_t phx_port_now(void)
{
    struct timespec now;
    long long ns, ms;

    if (told & PHX_LINE_TOLD_CLOCK)
        return told_ms;
    clock_gettime(CLOCK_MONOTONIC, &now);
    ns = (now.tv_sec - began.tv_sec) * 1000000000LL + (now.tv_nsec - began.tv_nsec);
    ms = ahead_ms + (ns + ns / 1000000 * ppm) / 1000000;
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

/* A command that finds no room is lost, as on any wire; a stop is said again at the next check, until it is taken. */
void phx_port_actuate(const uint8_t *command, uint32_t len)
{
    static const uint8_t stop = 0;
    static int stands;

    if (wheels < 0 || (len == 0 && stands))
        return;
    if (len > 0)
        stands = 0;
    if (send(wheels, len > 0 ? command : &stop, len > 0 ? len : 1, MSG_DONTWAIT | MSG_NOSIGNAL) > 0 && len == 0)
        stands = 1;
}

static int connect_wheels(const char *path)
{
    struct sockaddr_un there = {AF_UNIX, {0}};

    if (strcmp(path, "-") == 0)
        return 0;
    if (strlen(path) >= sizeof there.sun_path)
        return -1;
    strcpy(there.sun_path, path);
    wheels = socket(AF_UNIX, SOCK_SEQPACKET, 0);
    return connect(wheels, (struct sockaddr *)&there, sizeof there);
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
    if (argc < 2 || argc > 4 || (argc == 4 && sscanf(argv[3], "%d,%u", &ppm, &ahead_ms) != 2)) {
        fprintf(stderr, "usage: node FLASH_FILE [told|WHEELS [PPM,MS]]\n");
        return 2;
    }
    if (argc == 3 && strcmp(argv[2], "told") == 0)
        told |= PHX_LINE_TOLD_CLOCK;
    else if (argc >= 3 && connect_wheels(argv[2]) < 0) {
        fprintf(stderr, "node: %s: %s\n", argv[2], strerror(errno));
        return 1;
    }
    flash = open(argv[1], O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
    if (flash < 0) {
        fprintf(stderr, "node: %s: %s\n", argv[1], strerror(errno));
        return 1;
    }
    clock_gettime(CLOCK_MONOTONIC, &began);
    phx_serve();
    return 0;
}
