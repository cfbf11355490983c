/* A serial wire with a baud rate: joins the masters of two pseudo terminals.
 *
 *     wire BAUDRATE LEFT_FD RIGHT_FD [FIFO]
 *
 * Every byte takes the time of its ten bits (no parity, one stop bit), one after the other, in each direction by
 * itself. On SIGTERM it ends, with one line of JSON on stdout: the pauses inside of frames, each as the moment at
 * which the byte behind it came (CLOCK_MONOTONIC, ns) and how long the wire had been silent (ns). */
#define _GNU_SOURCE
#include "bench.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { BITS = 10, TRAVELLING = 4096, MAX_PAUSES = 100000, SECONDS = 3600 };

/* One direction. A byte is there when its last bit is: so many characters after the burst began. */
struct lane {
    int from, to;
    int64_t begun_ns, sent; /* the burst that travels, and how many bytes it has had */
    uint8_t bytes[TRAVELLING];
    int64_t there_ns[TRAVELLING];
    size_t first, count;
};

static long baudrate;
static int64_t silence_ns;
static volatile sig_atomic_t is_stopping;
static int64_t pauses[MAX_PAUSES][2];
static int pause_count;

static void heard(int number) {
    (void)number;
    is_stopping = 1;
}

static int64_t free_at(const struct lane *lane, int64_t bytes) {
    return lane->begun_ns + (bytes * BITS * 1000000000 + baudrate - 1) / baudrate;
}

static void send_on(struct lane *lane, const uint8_t *data, size_t length, int64_t at_ns) {
    int64_t pause_ns = lane->sent ? at_ns - free_at(lane, lane->sent) : 0;
    /* Whoever sends a frame begins it behind a whole silence; half of one stands between two frames. */
    if (pause_ns > 0 && pause_ns < silence_ns / 2) {
        if (pause_count == MAX_PAUSES) die("more than %d pauses", MAX_PAUSES);
        pauses[pause_count][0] = at_ns;
        pauses[pause_count++][1] = pause_ns;
    }
    if (!lane->sent || pause_ns >= 0) {
        lane->begun_ns = at_ns;
        lane->sent = 0;
    }
    for (size_t index = 0; index < length; index++) {
        if (lane->count == TRAVELLING) die("more than %d bytes on the wire", TRAVELLING);
        size_t at = (lane->first + lane->count++) % TRAVELLING;
        lane->bytes[at] = data[index];
        lane->there_ns[at] = free_at(lane, ++lane->sent);
    }
}

/* What has come leaves. A port that nobody reads loses it, as any serial port does. */
static void deliver(struct lane *lane, int64_t at_ns) {
    while (lane->count && lane->there_ns[lane->first] <= at_ns) {
        if (write(lane->to, &lane->bytes[lane->first], 1) < 0 && errno != EAGAIN) die("write: %s", strerror(errno));
        lane->first = (lane->first + 1) % TRAVELLING;
        lane->count--;
    }
}

int main(int argc, char **argv) {
    if (argc < 4) die("wire BAUDRATE LEFT_FD RIGHT_FD [FIFO]");
    baudrate = atol(argv[1]);
    if (baudrate <= 0) die("%s: a baud rate above 0 is wanted", argv[1]);
    /* 3.5 characters; from 19 200 on 1.75 ms (Modbus over serial line V1.02, 2.5.1.1). Characters have 11 bits
     * there, and 10 here: what is shorter is on the safe side. */
    silence_ns = baudrate > 19200 ? 1750000 : 35 * BITS * 100000000L / baudrate;
    int left = atoi(argv[2]), right = atoi(argv[3]);
    struct lane lanes[] = {{.from = left, .to = right}, {.from = right, .to = left}};
    struct pollfd polled[] = {{.fd = left, .events = POLLIN}, {.fd = right, .events = POLLIN}};
    settle_in(SECONDS);
    if (argc > 4) take_fifo(atoi(argv[4]));
    struct sigaction stop = {.sa_handler = heard};
    sigaction(SIGTERM, &stop, NULL);
    sigset_t term, none;
    sigemptyset(&none);
    sigemptyset(&term);
    sigaddset(&term, SIGTERM);
    sigprocmask(SIG_BLOCK, &term, NULL); /* it is heard in ppoll alone */
    for (int side = 0; side < 2; side++) fcntl(polled[side].fd, F_SETFL, O_NONBLOCK);
    while (!is_stopping) {
        int64_t next_ns = INT64_MAX, at_ns = now_ns();
        for (int side = 0; side < 2; side++) {
            deliver(&lanes[side], at_ns);
            if (lanes[side].count && lanes[side].there_ns[lanes[side].first] < next_ns)
                next_ns = lanes[side].there_ns[lanes[side].first];
        }
        int64_t wait_ns = next_ns == INT64_MAX ? 0 : next_ns - now_ns();
        if (wait_ns < 0) wait_ns = 0;
        struct timespec wait = {.tv_sec = wait_ns / 1000000000, .tv_nsec = wait_ns % 1000000000};
        if (ppoll(polled, 2, next_ns == INT64_MAX ? NULL : &wait, &none) < 0 && errno != EINTR)
            die("ppoll: %s", strerror(errno));
        for (int side = 0; side < 2; side++) {
            uint8_t data[512];
            if (!(polled[side].revents & POLLIN)) continue;
            ssize_t length = read(lanes[side].from, data, sizeof data);
            if (length > 0) send_on(&lanes[side], data, (size_t)length, now_ns());
        }
    }
    printf("[");
    for (int index = 0; index < pause_count; index++)
        printf("%s[%lld, %lld]", index ? ", " : "", (long long)pauses[index][0], (long long)pauses[index][1]);
    printf("]\n");
    return 0;
}
