/* Whether a processor was there for whoever wanted it: asks for it over and over, and notes when it came late.
 *
 *     witness PERIOD_US LATE_US FIFO
 *
 * Started on one processor. On SIGTERM it ends, with one line of JSON on stdout: each time that it came more than
 * LATE_US late, as the moment at which it should have run (CLOCK_MONOTONIC, ns) and how late it was (ns). Above
 * every other priority that is the machine's own doing: interrupts, the kernel, or a host that had other work. */
#define _GNU_SOURCE
#include "bench.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

enum { MAX_NOTED = 100000, SECONDS = 3600 };

static int64_t noted[MAX_NOTED][2];
static volatile sig_atomic_t is_stopping;

static void heard(int number) {
    (void)number;
    is_stopping = 1;
}

int main(int argc, char **argv) {
    if (argc != 4) die("witness PERIOD_US LATE_US FIFO");
    int64_t period_ns = atol(argv[1]) * 1000, late_ns = atol(argv[2]) * 1000;
    if (period_ns <= 0) die("%s: a period above 0 is wanted", argv[1]);
    settle_in(SECONDS);
    take_fifo(atoi(argv[3]));
    struct sigaction stop = {.sa_handler = heard};
    sigaction(SIGTERM, &stop, NULL);
    int count = 0;
    int64_t due_ns = now_ns();
    while (!is_stopping) {
        due_ns += period_ns;
        struct timespec due = {.tv_sec = due_ns / 1000000000, .tv_nsec = due_ns % 1000000000};
        if (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL)) continue;
        int64_t at_ns = now_ns();
        if (at_ns - due_ns <= late_ns) continue;
        if (count == MAX_NOTED) die("late more than %d times", MAX_NOTED);
        noted[count][0] = due_ns;
        noted[count++][1] = at_ns - due_ns;
        due_ns = at_ns;
    }
    printf("[");
    for (int index = 0; index < count; index++)
        printf("%s[%lld, %lld]", index ? ", " : "", (long long)noted[index][0], (long long)noted[index][1]);
    printf("]\n");
    return 0;
}
