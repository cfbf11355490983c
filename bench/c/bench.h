/* What the programs of the bench share: endpoints, clocks, Modbus frames. No library beyond libc. */
#ifndef BENCH_H
#define BENCH_H

#include <stddef.h>
#include <stdint.h>
#include <stdnoreturn.h>

enum framing { MBAP, RTU };

enum { MAX_ADU = 260, MBAP_HEADER = 7, MAX_PDU = 253 };

/* One frame as it lies in a buffer. */
struct frame {
    size_t adu_length;
    uint16_t transaction;
    uint8_t unit;
    const uint8_t *pdu;
    size_t pdu_length;
};

enum frame_state { FRAME_WHOLE, FRAME_PARTIAL, FRAME_BAD };
enum frame_kind { REQUEST, REPLY };

/* Ends the program with code 2 and a sentence on stderr. */
noreturn void die(const char *format, ...) __attribute__((format(printf, 1, 2)));

int64_t now_ns(void);

/* Ends with its parent, gets timers without slack, is bounded in time: SIGALRM ends it after `seconds`. */
void settle_in(unsigned seconds);

/* Asks for SCHED_FIFO; 0: nothing is asked for. Ends the program where the machine refuses. */
void take_fifo(int priority);

/* Opens "tcp:HOST:PORT" (connects), "tty:PATH" (raw), "fd:N" (inherited). `source` binds a TCP client to an
 * address of loopback, or is NULL. */
int open_endpoint(const char *spec, enum framing *framing, const char *source);

/* Opens "listen:PORT" on loopback and prints "port N" on stdout. */
int open_listener(const char *spec);

int accept_connection(int listener);

/* Writes everything, waiting where it must; 0, or -1 when the other end has gone. */
int write_all(int fd, const uint8_t *data, size_t length);

uint16_t crc16(const uint8_t *data, size_t length);
size_t encode_frame(enum framing, uint16_t transaction, uint8_t unit, const uint8_t *pdu, size_t length,
                    uint8_t *adu);

/* Looks for a frame at the start of a buffer. RTU ends by the length that the function code (3, 6, 16 and
 * exceptions) says. */
enum frame_state decode_frame(enum framing, enum frame_kind, const uint8_t *data, size_t length, struct frame *);

static inline uint16_t get16(const uint8_t *at) { return (uint16_t)(at[0] << 8 | at[1]); }

static inline void put16(uint8_t *at, unsigned value) {
    at[0] = (uint8_t)(value >> 8);
    at[1] = (uint8_t)value;
}

#endif
