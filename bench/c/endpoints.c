#define _GNU_SOURCE
#include "bench.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

noreturn void die(const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    vfprintf(stderr, format, arguments);
    va_end(arguments);
    fputc('\n', stderr);
    exit(2);
}

int64_t now_ns(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

void settle_in(unsigned seconds) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    prctl(PR_SET_TIMERSLACK, 1);
    signal(SIGPIPE, SIG_IGN);
    alarm(seconds);
}

void take_fifo(int priority) {
    if (!priority) return;
    struct sched_param wanted = {.sched_priority = priority};
    if (sched_setscheduler(0, SCHED_FIFO, &wanted)) die("SCHED_FIFO %d: %s", priority, strerror(errno));
}

static struct sockaddr_in address_of(const char *text) {
    struct sockaddr_in address = {.sin_family = AF_INET};
    char host[64];
    const char *colon = strrchr(text, ':');
    if (!colon || (size_t)(colon - text) >= sizeof host) die("%s: HOST:PORT is wanted", text);
    memcpy(host, text, (size_t)(colon - text));
    host[colon - text] = 0;
    if (inet_pton(AF_INET, host, &address.sin_addr) != 1) die("%s: no IPv4 address", text);
    address.sin_port = htons((uint16_t)atoi(colon + 1));
    return address;
}

static void without_delay(int fd) {
    int one = 1;
    setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
}

static void make_raw(int fd) {
    struct termios settings;
    if (tcgetattr(fd, &settings)) return; /* an inherited descriptor may be something else */
    cfmakeraw(&settings);
    tcsetattr(fd, TCSANOW, &settings);
}

int open_endpoint(const char *spec, enum framing *framing, const char *source) {
    *framing = RTU;
    int fd = -1;
    if (!strncmp(spec, "tcp:", 4)) {
        *framing = MBAP;
        struct sockaddr_in address = address_of(spec + 4);
        fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
        if (source) {
            struct sockaddr_in own = {.sin_family = AF_INET};
            inet_pton(AF_INET, source, &own.sin_addr);
            int one = 1;
            setsockopt(fd, IPPROTO_IP, IP_BIND_ADDRESS_NO_PORT, &one, sizeof one);
            if (bind(fd, (struct sockaddr *)&own, sizeof own)) die("bind %s: %s", source, strerror(errno));
        }
        if (connect(fd, (struct sockaddr *)&address, sizeof address)) die("%s: %s", spec, strerror(errno));
        without_delay(fd);
    } else if (!strncmp(spec, "tty:", 4)) {
        fd = open(spec + 4, O_RDWR | O_NOCTTY | O_CLOEXEC);
        if (fd < 0) die("%s: %s", spec, strerror(errno));
        make_raw(fd);
    } else if (!strncmp(spec, "fd:", 3)) {
        fd = atoi(spec + 3);
        if (fcntl(fd, F_GETFD) < 0) die("%s: %s", spec, strerror(errno));
        make_raw(fd);
    } else {
        die("%s: tcp:HOST:PORT, tty:PATH or fd:N is wanted", spec);
    }
    fcntl(fd, F_SETFL, fcntl(fd, F_GETFL) | O_NONBLOCK);
    return fd;
}

int open_listener(const char *spec) {
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    address.sin_port = htons((uint16_t)atoi(spec + strlen("listen:")));
    int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0), one = 1;
    setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &one, sizeof one);
    socklen_t size = sizeof address;
    if (bind(fd, (struct sockaddr *)&address, size) || listen(fd, 128)) die("%s: %s", spec, strerror(errno));
    getsockname(fd, (struct sockaddr *)&address, &size);
    printf("port %d\n", ntohs(address.sin_port));
    fflush(stdout);
    return fd;
}

int accept_connection(int listener) {
    int fd = accept4(listener, NULL, NULL, SOCK_CLOEXEC | SOCK_NONBLOCK);
    if (fd >= 0) without_delay(fd);
    return fd;
}

int write_all(int fd, const uint8_t *data, size_t length) {
    while (length) {
        ssize_t written = write(fd, data, length);
        if (written > 0) {
            data += written;
            length -= (size_t)written;
        } else if (errno == EAGAIN) {
            struct pollfd room = {.fd = fd, .events = POLLOUT};
            if (poll(&room, 1, 1000) <= 0) return -1;
        } else if (errno != EINTR) {
            return -1;
        }
    }
    return 0;
}
