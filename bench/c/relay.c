/* A relay in C: what forwarding costs at least.
 *
 *     relay LEFT RIGHT              bytes, as they come
 *     relay --convert LEFT RIGHT    Modbus/TCP on the left, RTU on the right
 *
 * LEFT may be listen:PORT: it serves one controller after the other and connects to RIGHT for each. */
#include "bench.h"

#include <errno.h>
#include <poll.h>
#include <string.h>
#include <unistd.h>

struct way {
    int from, to;
    enum frame_kind kind;
    enum framing in, out;
    uint8_t held[4 * MAX_ADU];
    size_t length;
};

static uint16_t transaction; /* of the request on the wire: an RTU reply has none */

static int convert(struct way *way) {
    for (;;) {
        struct frame frame;
        enum frame_state state = decode_frame(way->in, way->kind, way->held, way->length, &frame);
        if (state == FRAME_PARTIAL) return 0;
        if (state == FRAME_BAD) return -1;
        if (way->kind == REQUEST) transaction = frame.transaction;
        uint8_t adu[MAX_ADU];
        size_t length = encode_frame(way->out, transaction, frame.unit, frame.pdu, frame.pdu_length, adu);
        if (write_all(way->to, adu, length)) return -1;
        way->length -= frame.adu_length;
        memmove(way->held, way->held + frame.adu_length, way->length);
    }
}

static int forward(struct way *way, int is_converting) {
    ssize_t got = read(way->from, way->held + way->length, sizeof way->held - way->length);
    if (got < 0 && (errno == EAGAIN || errno == EINTR)) return 0;
    if (got <= 0) return -1;
    if (!is_converting) return write_all(way->to, way->held, (size_t)got);
    way->length += (size_t)got;
    return convert(way);
}

static void serve(int left, int right, int is_converting) {
    struct way ways[2] = {
        {.from = left, .to = right, .kind = REQUEST, .in = MBAP, .out = RTU},
        {.from = right, .to = left, .kind = REPLY, .in = RTU, .out = MBAP},
    };
    struct pollfd ends[2] = {{.fd = left, .events = POLLIN}, {.fd = right, .events = POLLIN}};
    for (;;) {
        if (poll(ends, 2, -1) < 0 && errno != EINTR) return;
        for (int i = 0; i < 2; i++)
            if (ends[i].revents && forward(&ways[i], is_converting)) return;
    }
}

int main(int count, char **words) {
    int is_converting = count > 1 && !strcmp(words[1], "--convert");
    if (count != 3 + is_converting) die("relay [--convert] LEFT RIGHT");
    const char *left = words[1 + is_converting], *right = words[2 + is_converting];
    enum framing framing;
    settle_in(3600);
    if (strncmp(left, "listen:", 7)) {
        serve(open_endpoint(left, &framing, NULL), open_endpoint(right, &framing, NULL), is_converting);
        return 1;
    }
    int listener = open_listener(left);
    struct pollfd waiting = {.fd = listener, .events = POLLIN};
    for (;;) {
        poll(&waiting, 1, -1);
        int near = accept_connection(listener);
        if (near < 0) continue;
        int far = open_endpoint(right, &framing, NULL);
        serve(near, far, is_converting);
        close(near);
        if (strncmp(right, "fd:", 3)) close(far);
    }
}
