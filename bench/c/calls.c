/* How fast the machine's own system calls are: all figures over sockets depend on them.
 *
 *     calls ROUNDS
 *
 * Prints one line of JSON, in nanoseconds, each the median of ROUNDS batches: "getppid" (a call that does nothing),
 * "pipe" (a byte written into a pipe and read again), "epoll" (an event announced, waited for and taken) and
 * "process" (a byte through a pipe to another process and back: the system changes between the two twice). */
#define _GNU_SOURCE
#include "bench.h"

#include <stdio.h>
#include <stdlib.h>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <sys/syscall.h>
#include <unistd.h>

enum { BATCH = 500, MAX_ROUNDS = 1000, SECONDS = 60 };

static int near[2], there[2], back[2], epoll_fd, event_fd;

static void must(int is_good) {
    if (!is_good) die("calls: the system refuses a call");
}

static void pass_on(int to, int from) {
    char byte = 0;
    must(write(to, &byte, 1) == 1 && read(from, &byte, 1) == 1);
}

static void nothing(void) { syscall(SYS_getppid); }

static void through_pipe(void) { pass_on(near[1], near[0]); }

static void by_epoll(void) {
    uint64_t count = 1;
    struct epoll_event event;
    must(write(event_fd, &count, sizeof count) == sizeof count && epoll_wait(epoll_fd, &event, 1, -1) == 1 &&
         read(event_fd, &count, sizeof count) == sizeof count);
}

static void to_another_process(void) { pass_on(there[1], back[0]); }

/* Sends back what it gets, until there is nobody who sends. */
static void echo(void) {
    char byte;
    settle_in(SECONDS);
    close(there[1]);
    while (read(there[0], &byte, 1) == 1) must(write(back[1], &byte, 1) == 1);
    _exit(0);
}

static int by_size(const void *left, const void *right) {
    double difference = *(const double *)left - *(const double *)right;
    return (difference > 0) - (difference < 0);
}

static double median_ns(void (*call)(void), int rounds) {
    static double taken_ns[MAX_ROUNDS];
    for (int round = -1; round < rounds; round++) { /* the first one warms up */
        int64_t start_ns = now_ns();
        for (int i = 0; i < BATCH; i++) call();
        if (round >= 0) taken_ns[round] = (double)(now_ns() - start_ns) / BATCH;
    }
    qsort(taken_ns, (size_t)rounds, sizeof *taken_ns, by_size);
    return taken_ns[rounds / 2];
}

int main(int count, char **words) {
    int rounds = count == 2 ? atoi(words[1]) : 0;
    if (rounds < 1 || rounds > MAX_ROUNDS) die("calls ROUNDS (1 to %d)", MAX_ROUNDS);
    settle_in(SECONDS);
    must(!pipe(near) && !pipe(there) && !pipe(back));
    epoll_fd = epoll_create1(0);
    event_fd = eventfd(0, 0);
    struct epoll_event event = {.events = EPOLLIN};
    must(!epoll_ctl(epoll_fd, EPOLL_CTL_ADD, event_fd, &event));
    pid_t other = fork();
    must(other >= 0);
    if (!other) echo();
    double taken_ns[] = {median_ns(nothing, rounds), median_ns(through_pipe, rounds), median_ns(by_epoll, rounds),
                         median_ns(to_another_process, rounds)};
    printf("{\"getppid\": %.0f, \"pipe\": %.0f, \"epoll\": %.0f, \"process\": %.0f}\n", taken_ns[0], taken_ns[1],
           taken_ns[2], taken_ns[3]);
    return 0;
}
