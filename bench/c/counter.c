/* Counts what processes do in user mode, with a counter of the processor.
 *
 *     counter instructions|task-clock TID...
 *
 * Counts each thread, and those that it starts. Prints "ready", counts until SIGTERM, and prints the sum.
 * "task-clock" counts nanoseconds and needs no counter of the processor. Where there is none, as on most virtual
 * machines, or it is not allowed, it ends with code 2 and says so. */
#define _GNU_SOURCE
#include "bench.h"

#include <errno.h>
#include <linux/perf_event.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <unistd.h>

enum { MAX_THREADS = 256, SECONDS = 3600 };

int main(int count, char **words) {
    int is_clock = count > 1 && !strcmp(words[1], "task-clock"), threads = count - 2, fds[MAX_THREADS];
    if (threads < 1 || threads > MAX_THREADS || (!is_clock && strcmp(words[1], "instructions")))
        die("counter instructions|task-clock TID... (1 to %d)", MAX_THREADS);
    struct perf_event_attr wanted = {
        .size = sizeof wanted,
        .type = is_clock ? PERF_TYPE_SOFTWARE : PERF_TYPE_HARDWARE,
        .config = is_clock ? PERF_COUNT_SW_TASK_CLOCK : PERF_COUNT_HW_INSTRUCTIONS,
        .exclude_kernel = 1,
        .exclude_hv = 1,
        .inherit = 1,
    };
    sigset_t stops;
    sigemptyset(&stops);
    sigaddset(&stops, SIGTERM);
    sigprocmask(SIG_BLOCK, &stops, NULL);
    settle_in(SECONDS);
    for (int i = 0; i < threads; i++) {
        fds[i] = (int)syscall(SYS_perf_event_open, &wanted, (pid_t)atoi(words[2 + i]), -1, -1, 0);
        if (fds[i] < 0) die("perf_event_open: %s", strerror(errno));
    }
    puts("ready");
    fflush(stdout);
    int number;
    sigwait(&stops, &number);
    uint64_t sum = 0, one;
    for (int i = 0; i < threads; i++) {
        if (read(fds[i], &one, sizeof one) != sizeof one) die("counter: %s", strerror(errno));
        sum += one;
    }
    printf("%llu\n", (unsigned long long)sum);
    return 0;
}
