/* A controller: sends requests, checks every reply, keeps every latency.
 *
 *     load [OPTION VALUE]... TO...
 *
 *     --kind write        function code 16, one 32-bit position that changes each time (default)
 *            read         function code 3, four registers that hold no position
 *            cycle        write, read the position back (it must be what was written), read four registers
 *     --count N           exchanges that count (default 20000); --warmup N before them (default 500)
 *     --period-us N       a request every N microseconds, also when the last one was answered late; 0: as soon
 *                         as the last one is answered
 *     --units 1,2,3       unit ids, taken in turn
 *     --lines N           connection 1, N + 1, … is on one line, 2, N + 2, … on the next (default 1)
 *     --concurrent 1      every connection has a request of its own under way; 0: one request at a time in all
 *     --reconnect 1       a new TCP connection for every exchange
 *     --timeout-ms N      how long a reply is waited for (default 1000)
 *     --fifo N            SCHED_FIFO priority of the controller itself
 *     --seconds N         ends after so long at the latest (default 600)
 *     --out FILE          for each exchange two int64 in nanoseconds: reply - when the request was due,
 *                         reply - when it was sent
 *
 * Prints one line of JSON. Exit code 0: every reply came and was right; 1: not so; 2: wrong usage. */
#define _GNU_SOURCE
#include "bench.h"

#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

enum { POSITION = 100, MAX_CONNECTIONS = 256, MAX_UNITS = 32, MAX_FAULTS = 10 };
enum kind { WRITE, READ, CYCLE };

struct connection {
    const char *spec;
    int fd;
    enum framing framing;
    uint16_t transaction;
    uint8_t unit;
    long steps;
    int32_t written[256]; /* by unit */
    uint8_t pdu[16];
    size_t pdu_length;
    int64_t due_ns, sent_ns;
    uint8_t held[4 * MAX_ADU];
    size_t length;
};

static struct connection connections[MAX_CONNECTIONS];
static int connection_count, unit_count = 1, lines = 1;
static uint8_t units[MAX_UNITS] = {1};
static enum kind kind = WRITE;
static long count = 20000, warmup = 500, period_us, timeout_ms = 1000;
static int is_concurrent, is_reconnecting;
static int64_t (*latencies)[2];
static long writes[MAX_CONNECTIONS][256]; /* by line and unit: whoever commands an axis goes on from where it was */
static long sent, answered, timeouts, wrong, late;

/* Up and down between 0 and 100 000 counts, never the same twice in a row. */
static int32_t position_of(long step) {
    long place = step % 4000;
    return (int32_t)(50 * (place < 2000 ? place : 4000 - place));
}

static void compose(struct connection *c) {
    long step = c->steps++, group = kind == CYCLE ? step / 3 : step;
    c->unit = units[group % unit_count];
    int phase = kind == CYCLE ? (int)(step % 3) : kind == WRITE ? 0 : 2;
    uint8_t *pdu = c->pdu;
    if (phase == 0) {
        int32_t position = position_of(++writes[(c - connections) % lines][c->unit]);
        c->written[c->unit] = position;
        static const uint8_t head[] = {16, 0, POSITION, 0, 2, 4};
        memcpy(pdu, head, sizeof head);
        put16(pdu + 6, (uint32_t)position >> 16);
        put16(pdu + 8, (uint32_t)position & 0xFFFF);
        c->pdu_length = 10;
    } else {
        const uint8_t read[] = {3, 0, phase == 1 ? POSITION : 0, 0, phase == 1 ? 2 : 4};
        memcpy(pdu, read, sizeof read);
        c->pdu_length = 5;
    }
}

/* Whether a reply is, byte for byte, what this request must be answered with. */
static int is_right(const struct connection *c, const struct frame *frame) {
    uint8_t wanted[16] = {0};
    size_t length = 5;
    if (c->pdu[0] == 16) {
        memcpy(wanted, c->pdu, 5);
    } else {
        wanted[0] = 3;
        wanted[1] = (uint8_t)(2 * c->pdu[4]);
        length = 2u + wanted[1];
        if (c->pdu[2] == POSITION) {
            put16(wanted + 2, (uint32_t)c->written[c->unit] >> 16);
            put16(wanted + 4, (uint32_t)c->written[c->unit] & 0xFFFF);
        }
    }
    return frame->unit == c->unit && (c->framing == RTU || frame->transaction == c->transaction) &&
           frame->pdu_length == length && !memcmp(frame->pdu, wanted, length);
}

static void complain(const struct connection *c, const uint8_t *data, size_t length, const char *what) {
    if (++wrong > MAX_FAULTS) return;
    fprintf(stderr, "%s: %s:", c->spec, what);
    for (size_t i = 0; i < length && i < 32; i++) fprintf(stderr, " %02x", data[i]);
    fputc('\n', stderr);
}

static void open_connection(struct connection *c) {
    char source[32];
    /* Every closed connection holds its port for a minute: loopback has enough addresses to begin elsewhere. */
    snprintf(source, sizeof source, "127.0.%ld.%ld", 1 + sent / 250 % 200, 1 + sent % 250);
    c->fd = open_endpoint(c->spec, &c->framing, is_reconnecting ? source : NULL);
    c->length = 0;
}

static void transmit(struct connection *c, int64_t due_ns) {
    compose(c);
    uint8_t adu[MAX_ADU];
    c->due_ns = due_ns ? due_ns : now_ns();
    if (is_reconnecting) open_connection(c);
    size_t length = encode_frame(c->framing, ++c->transaction, c->unit, c->pdu, c->pdu_length, adu);
    c->sent_ns = due_ns || is_reconnecting ? now_ns() : c->due_ns;
    sent++;
    if (write_all(c->fd, adu, length)) die("%s: the other end has gone", c->spec);
}

/* Reads what has come; 1 when the request under way is done with. */
static int receive(struct connection *c) {
    ssize_t got = read(c->fd, c->held + c->length, sizeof c->held - c->length);
    int64_t arrived_ns = now_ns();
    if (got < 0 && (errno == EAGAIN || errno == EINTR)) return 0;
    if (got <= 0) die("%s: closed by the other end", c->spec);
    c->length += (size_t)got;
    struct frame frame;
    enum frame_state state = decode_frame(c->framing, REPLY, c->held, c->length, &frame);
    if (state == FRAME_PARTIAL) return 0;
    if (state == FRAME_BAD) {
        complain(c, c->held, c->length, "no frame");
    } else if (frame.adu_length != c->length || !is_right(c, &frame)) {
        complain(c, c->held, c->length, "not the reply to this request");
    } else if (answered++ >= warmup) {
        latencies[answered - 1 - warmup][0] = arrived_ns - c->due_ns;
        latencies[answered - 1 - warmup][1] = arrived_ns - c->sent_ns;
    }
    c->length = 0;
    if (is_reconnecting) close(c->fd);
    return 1;
}

static void give_up(struct connection *c) {
    timeouts++;
    fprintf(stderr, "%s: no reply in %ld ms\n", c->spec, timeout_ms);
    while (read(c->fd, c->held, sizeof c->held) > 0) continue;
    c->length = 0;
    if (is_reconnecting) close(c->fd);
}

static int64_t wait_until(int64_t due_ns) {
    if (now_ns() > due_ns) late++;
    struct timespec due = {.tv_sec = due_ns / 1000000000, .tv_nsec = due_ns % 1000000000};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL) == EINTR) continue;
    return due_ns;
}

static void one_at_a_time(long total) {
    int64_t start_ns = now_ns();
    for (long n = 0; n < total && timeouts + wrong < MAX_FAULTS; n++) {
        struct connection *c = &connections[(kind == CYCLE ? n / 3 : n) % connection_count];
        transmit(c, period_us ? wait_until(start_ns + (n + 1) * period_us * 1000) : 0);
        struct pollfd reply = {.fd = c->fd, .events = POLLIN};
        for (;;) {
            if (poll(&reply, 1, (int)timeout_ms) == 0) {
                give_up(c);
                break;
            }
            if (receive(c)) break;
        }
    }
}

static void all_at_once(long total) {
    struct pollfd replies[MAX_CONNECTIONS];
    for (int i = 0; i < connection_count; i++) {
        replies[i] = (struct pollfd){.fd = connections[i].fd, .events = POLLIN};
        transmit(&connections[i], 0);
    }
    while (answered + wrong < total && wrong < MAX_FAULTS) {
        if (poll(replies, (nfds_t)connection_count, (int)timeout_ms) == 0) {
            give_up(&connections[0]); /* nobody at all was answered */
            return;
        }
        for (int i = 0; i < connection_count; i++)
            if (replies[i].revents && receive(&connections[i]) && sent < total) transmit(&connections[i], 0);
    }
}

static void read_units(char *list) {
    unit_count = 0;
    for (char *unit = strtok(list, ","); unit && unit_count < MAX_UNITS; unit = strtok(NULL, ","))
        units[unit_count++] = (uint8_t)atoi(unit);
    if (!unit_count) die("--units 1,2,3");
}

static void read_kind(const char *name) {
    if (!strcmp(name, "write")) kind = WRITE;
    else if (!strcmp(name, "read")) kind = READ;
    else if (!strcmp(name, "cycle")) kind = CYCLE;
    else die("--kind write, read or cycle");
}

static void write_latencies(const char *path) {
    FILE *file = fopen(path, "wb");
    size_t kept = answered > warmup ? (size_t)(answered - warmup) : 0;
    if (!file || fwrite(latencies, sizeof *latencies, kept, file) != kept || fclose(file))
        die("%s: %s", path, strerror(errno));
}

int main(int words_count, char **words) {
    const char *path = NULL;
    unsigned seconds = 600;
    int word = 1, fifo = 0;
    for (; word + 1 < words_count && !strncmp(words[word], "--", 2); word += 2) {
        const char *name = words[word] + 2;
        char *value = words[word + 1];
        if (!strcmp(name, "kind")) read_kind(value);
        else if (!strcmp(name, "count")) count = atol(value);
        else if (!strcmp(name, "warmup")) warmup = atol(value);
        else if (!strcmp(name, "period-us")) period_us = atol(value);
        else if (!strcmp(name, "units")) read_units(value);
        else if (!strcmp(name, "lines")) lines = atoi(value);
        else if (!strcmp(name, "concurrent")) is_concurrent = atoi(value);
        else if (!strcmp(name, "reconnect")) is_reconnecting = atoi(value);
        else if (!strcmp(name, "timeout-ms")) timeout_ms = atol(value);
        else if (!strcmp(name, "fifo")) fifo = atoi(value);
        else if (!strcmp(name, "seconds")) seconds = (unsigned)atoi(value);
        else if (!strcmp(name, "out")) path = value;
        else die("%s: no option of load", words[word]);
    }
    connection_count = words_count - word;
    if (connection_count < 1 || connection_count > MAX_CONNECTIONS || count < 1 || warmup < 0 || lines < 1)
        die("load [OPTION VALUE]... TO... (1 to %d)", MAX_CONNECTIONS);
    settle_in(seconds);
    latencies = calloc((size_t)count + MAX_CONNECTIONS, sizeof *latencies);
    memset(latencies, 1, ((size_t)count + MAX_CONNECTIONS) * sizeof *latencies); /* no page faults later */
    for (int i = 0; i < connection_count; i++) {
        connections[i].spec = words[word + i];
        connections[i].steps = 0;
        if (!is_reconnecting) open_connection(&connections[i]);
    }
    take_fifo(fifo);
    int64_t start_ns = now_ns();
    if (is_concurrent) all_at_once(count + warmup);
    else one_at_a_time(count + warmup);
    double took_s = (double)(now_ns() - start_ns) / 1e9;
    if (path) write_latencies(path);
    printf("{\"sent\": %ld, \"answered\": %ld, \"timeouts\": %ld, \"wrong\": %ld, \"late\": %ld, \"seconds\": %.6f}\n",
           sent, answered, timeouts, wrong, late, took_s);
    return answered == count + warmup ? 0 : 1;
}
