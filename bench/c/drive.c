/* Drives at the end of the line: registers behind TCP listeners and serial ports.
 *
 *     drive [--arrivals FILE] [--delay-us N] [--fifo N] [--seconds N] AT...
 *
 * AT is listen:PORT, tty:PATH or fd:N; each has 256 units of REGISTERS registers. Answers function codes 3, 6
 * and 16. On SIGUSR1 it writes the times of arrival of the writes since the last time (int64, CLOCK_MONOTONIC,
 * ns) into FILE. On SIGTERM it ends, with one line of JSON about what it counted on stdout. */
#define _GNU_SOURCE
#include "bench.h"

#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

enum { REGISTERS = 1024, UNITS = 256, MAX_ENDS = 512, MAX_ARRIVALS = 4000000 };

struct end {
    int fd, is_listener;
    enum framing framing;
    uint16_t *registers;
    uint8_t held[8 * MAX_ADU];
    size_t length;
};

static struct end ends[MAX_ENDS];
static struct pollfd polled[MAX_ENDS];
static int end_count;
static long requests, writes, bad_frames, exceptions;
static int64_t *arrivals;
static long arrival_count;
static long delay_us;
static volatile sig_atomic_t is_stopping, is_asked;

static void heard(int number) {
    if (number == SIGUSR1) is_asked = 1;
    else is_stopping = 1;
}

static void add_end(int fd, int is_listener, enum framing framing, uint16_t *registers) {
    if (end_count == MAX_ENDS) die("more than %d connections", MAX_ENDS);
    ends[end_count] = (struct end){.fd = fd, .is_listener = is_listener, .framing = framing, .registers = registers};
    polled[end_count++] = (struct pollfd){.fd = fd, .events = POLLIN};
}

static void remove_end(int index) {
    close(ends[index].fd);
    end_count--;
    ends[index] = ends[end_count];
    polled[index] = polled[end_count];
}

static size_t refuse(const uint8_t *pdu, uint8_t code, uint8_t *reply) {
    exceptions++;
    reply[0] = pdu[0] | 0x80;
    reply[1] = code;
    return 2;
}

/* Answers one request; returns the length of the reply. */
static size_t answer(uint16_t *unit, const struct frame *frame, uint8_t *reply) {
    const uint8_t *pdu = frame->pdu;
    if (frame->pdu_length < 5 || (pdu[0] != 3 && pdu[0] != 6 && pdu[0] != 16)) return refuse(pdu, 1, reply);
    unsigned address = get16(pdu + 1), amount = pdu[0] == 6 ? 1 : get16(pdu + 3);
    if (!amount || amount > 125) return refuse(pdu, 3, reply);
    if (address + amount > REGISTERS) return refuse(pdu, 2, reply);
    memcpy(reply, pdu, 5);
    if (pdu[0] == 3) {
        reply[1] = (uint8_t)(2 * amount);
        for (unsigned i = 0; i < amount; i++) put16(reply + 2 + 2 * i, unit[address + i]);
        return 2 + 2 * amount;
    }
    if (pdu[0] == 16 && frame->pdu_length != 6 + 2 * amount) return refuse(pdu, 3, reply);
    const uint8_t *values = pdu[0] == 6 ? pdu + 3 : pdu + 6;
    for (unsigned i = 0; i < amount; i++) unit[address + i] = get16(values + 2 * i);
    return 5;
}

/* Answers every whole request in the buffer; -1 when the other end has gone. */
static int answer_all(struct end *end, int64_t arrived_ns) {
    struct frame frame;
    for (;;) {
        enum frame_state state = decode_frame(end->framing, REQUEST, end->held, end->length, &frame);
        if (state == FRAME_PARTIAL) return 0;
        if (state == FRAME_BAD) {
            bad_frames++;
            end->length = 0;
            return end->framing == MBAP ? -1 : 0;
        }
        requests++;
        if (frame.pdu[0] != 3) {
            if (arrivals && arrival_count < MAX_ARRIVALS) arrivals[arrival_count++] = arrived_ns;
            writes++;
        }
        uint8_t reply[MAX_PDU], adu[MAX_ADU];
        size_t length = answer(end->registers + (size_t)frame.unit * REGISTERS, &frame, reply);
        length = encode_frame(end->framing, frame.transaction, frame.unit, reply, length, adu);
        if (delay_us) nanosleep(&(struct timespec){.tv_nsec = delay_us * 1000}, NULL);
        if (write_all(end->fd, adu, length)) return -1;
        end->length -= frame.adu_length;
        memmove(end->held, end->held + frame.adu_length, end->length);
    }
}

static void serve(int index) {
    struct end *end = &ends[index];
    if (end->is_listener) {
        int fd = accept_connection(end->fd);
        if (fd >= 0) add_end(fd, 0, MBAP, end->registers);
        return;
    }
    ssize_t got = read(end->fd, end->held + end->length, sizeof end->held - end->length);
    if (got < 0 && (errno == EAGAIN || errno == EINTR)) return;
    if (got < 0 && errno == EIO && end->framing == RTU) return; /* nobody has the port open at the moment */
    end->length += got > 0 ? (size_t)got : 0;
    if (got <= 0 || answer_all(end, now_ns())) remove_end(index);
}

static void open_all(int count, char **specs) {
    for (int i = 0; i < count; i++) {
        uint16_t *registers = calloc((size_t)UNITS * REGISTERS, sizeof *registers);
        enum framing framing = MBAP;
        int is_listener = !strncmp(specs[i], "listen:", 7);
        int fd = is_listener ? open_listener(specs[i]) : open_endpoint(specs[i], &framing, NULL);
        add_end(fd, is_listener, framing, registers);
    }
}

/* Under another name first: whoever sees the file sees all of it. */
static void write_arrivals(const char *path) {
    char unfinished[4096];
    is_asked = 0;
    snprintf(unfinished, sizeof unfinished, "%s.unfinished", path);
    FILE *file = fopen(unfinished, "wb");
    size_t number = (size_t)arrival_count;
    if (!file || fwrite(arrivals, sizeof *arrivals, number, file) != number || fclose(file) ||
        rename(unfinished, path))
        die("%s: %s", path, strerror(errno));
    arrival_count = 0;
}

int main(int count, char **words) {
    const char *path = NULL;
    int fifo = 0, word = 1;
    unsigned seconds = 3600;
    for (; word + 1 < count && !strncmp(words[word], "--", 2); word += 2) {
        if (!strcmp(words[word], "--arrivals")) path = words[word + 1];
        else if (!strcmp(words[word], "--delay-us")) delay_us = atol(words[word + 1]);
        else if (!strcmp(words[word], "--fifo")) fifo = atoi(words[word + 1]);
        else if (!strcmp(words[word], "--seconds")) seconds = (unsigned)atoi(words[word + 1]);
        else die("%s: no option of drive", words[word]);
    }
    if (word >= count) die("drive [--arrivals FILE] [--delay-us N] [--fifo N] [--seconds N] AT...");
    settle_in(seconds);
    sigaction(SIGTERM, &(struct sigaction){.sa_handler = heard}, NULL);
    sigaction(SIGUSR1, &(struct sigaction){.sa_handler = heard}, NULL);
    signal(SIGINT, SIG_IGN);
    if (path) {
        arrivals = calloc(MAX_ARRIVALS, sizeof *arrivals);
        mlockall(MCL_CURRENT | MCL_FUTURE); /* where it is not allowed a page fault costs a microsecond */
    }
    open_all(count - word, words + word);
    take_fifo(fifo);
    puts("ready");
    fflush(stdout);
    while (!is_stopping) {
        if (is_asked && path) write_arrivals(path);
        if (ppoll(polled, (nfds_t)end_count, &(struct timespec){.tv_nsec = 200000000}, NULL) <= 0) continue;
        for (int i = end_count - 1; i >= 0; i--)
            if (polled[i].revents) serve(i);
    }
    printf("{\"requests\": %ld, \"writes\": %ld, \"bad_frames\": %ld, \"exceptions\": %ld}\n", requests, writes,
           bad_frames, exceptions);
    return 0;
}
