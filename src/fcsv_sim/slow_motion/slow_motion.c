// SPDX-License-Identifier: Apache-2.0
/* Slow motion for whole programs: preloaded (LD_PRELOAD), it lets clocks pass more slowly and waits last longer, at a
 * rate that may change while they run. All programs that read one page of memory (FCSV_SLOW_MOTION: its file) share one
 * time, which lags behind that of the computer by the same amount on every clock. fcsv_sim/machines/slow_motion.py writes it, many
 * times a second; where it cannot, because the whole machine was halted, time stands still at the horizon of the page.
 *
 * Not slowed: what the kernel times by itself (alarm, timerfd, SO_RCVTIMEO, TCP), and time of the processor.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/epoll.h>
#include <sys/mman.h>
#include <sys/select.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#define NS 1000000000LL
#define LEAST_RATE 0.01
#define DESERTED_NS (10 * NS) /* without a tick: nobody writes the page any more */
#define SLICE_NS (NS / 5) /* of a sleep: then the rate may be another */
#define DATED_S 1000000000L /* a moment of more seconds than this is one of CLOCK_REALTIME */

struct part {
    int64_t since_ns, lag_ns; /* CLOCK_MONOTONIC, and how far behind all clocks were then */
    int64_t horizon_ns;       /* the slow CLOCK_MONOTONIC goes no further */
    double rate;
};
/* The writer fills the part that is not in use, then counts: the last bit says which is. */
struct page {
    _Atomic uint64_t count;
    struct part part[2];
};

static const struct page *page;
static pthread_once_t once = PTHREAD_ONCE_INIT;
static int (*real_gettime)(clockid_t, struct timespec *);
static int (*real_nanosleep)(clockid_t, int, const struct timespec *, struct timespec *);
static int (*real_pselect)(int, fd_set *, fd_set *, fd_set *, const struct timespec *, const sigset_t *);
static int (*real_poll)(struct pollfd *, nfds_t, int);
static int (*real_ppoll)(struct pollfd *, nfds_t, const struct timespec *, const sigset_t *);
static int (*real_epoll)(int, struct epoll_event *, int, int);
static int (*real_epoll_p)(int, struct epoll_event *, int, int, const sigset_t *);
static int (*real_sem)(sem_t *, const struct timespec *);
static int (*real_sem_clock)(sem_t *, clockid_t, const struct timespec *);
static int (*real_cond)(pthread_cond_t *, pthread_mutex_t *, const struct timespec *);
static int (*real_cond_clock)(pthread_cond_t *, pthread_mutex_t *, clockid_t, const struct timespec *);

static void *next_cond_timedwait(void) {
    /* without a version one gets the condition variables of before 2003 */
    const char *versions[] = {"GLIBC_2.3.2", "GLIBC_2.17"};
    for (int i = 0; i < 2; i++) {
        void *found = dlvsym(RTLD_NEXT, "pthread_cond_timedwait", versions[i]);
        if (found) return found;
    }
    return dlsym(RTLD_NEXT, "pthread_cond_timedwait");
}

static void open_all(void) {
    real_gettime = dlsym(RTLD_NEXT, "clock_gettime");
    real_nanosleep = dlsym(RTLD_NEXT, "clock_nanosleep");
    real_pselect = dlsym(RTLD_NEXT, "pselect");
    real_poll = dlsym(RTLD_NEXT, "poll");
    real_ppoll = dlsym(RTLD_NEXT, "ppoll");
    real_epoll = dlsym(RTLD_NEXT, "epoll_wait");
    real_epoll_p = dlsym(RTLD_NEXT, "epoll_pwait");
    real_sem = dlsym(RTLD_NEXT, "sem_timedwait");
    real_sem_clock = dlsym(RTLD_NEXT, "sem_clockwait");
    real_cond = next_cond_timedwait();
    real_cond_clock = dlsym(RTLD_NEXT, "pthread_cond_clockwait");
    const char *path = getenv("FCSV_SLOW_MOTION");
    int file = path ? open(path, O_RDONLY | O_CLOEXEC) : -1;
    if (file >= 0) {
        void *found = mmap(NULL, sizeof(struct page), PROT_READ, MAP_SHARED, file, 0);
        if (found != MAP_FAILED) page = found;
        close(file);
    }
}

static void begin(void) { pthread_once(&once, open_all); }

static int64_t ns(const struct timespec *t) { return t->tv_sec * NS + t->tv_nsec; }
static struct timespec spec(int64_t t) {
    if (t < 0) t = 0;
    return (struct timespec){t / NS, t % NS};
}

static struct part now_used(void) {
    struct part found = {0, 0, INT64_MAX, 1.0};
    uint64_t count;
    if (!page) return found;
    do {
        count = atomic_load_explicit(&page->count, memory_order_acquire);
        found = page->part[count & 1];
        atomic_thread_fence(memory_order_acquire);
    } while (atomic_load_explicit(&page->count, memory_order_relaxed) != count); /* may be half of the next */
    return found;
}

static double rate(void) {
    double r = now_used().rate;
    return r > LEAST_RATE ? r : LEAST_RATE;
}

static int64_t lag_ns(void) {
    struct timespec t;
    struct part p = now_used();
    real_gettime(CLOCK_MONOTONIC, &t);
    int64_t lag = p.lag_ns + (int64_t)((ns(&t) - p.since_ns) * (1.0 - p.rate));
    int64_t beyond = ns(&t) - lag - p.horizon_ns;
    int64_t deserted = ns(&t) - p.since_ns - DESERTED_NS; /* then time goes on: who waits with a limit must end */
    return beyond <= 0 ? lag : lag + beyond - (deserted > 0 ? deserted : 0);
}

static int slowed(clockid_t clock) {
    switch (clock) {
    case CLOCK_PROCESS_CPUTIME_ID:
    case CLOCK_THREAD_CPUTIME_ID:
        return 0;
    default:
        return page != NULL && clock >= 0; /* negative: of another process or a device */
    }
}

/* All moments below are of the slow time unless their name says real. */
static int64_t moment(clockid_t clock) {
    struct timespec t;
    real_gettime(clock, &t);
    return ns(&t) - (slowed(clock) ? lag_ns() : 0);
}

static struct timespec real_moment(clockid_t clock, const struct timespec *at) {
    struct timespec t;
    int64_t to_go = ns(at) - moment(clock);
    real_gettime(clock, &t);
    return spec(ns(&t) + (to_go > 0 ? (int64_t)(to_go / rate()) : to_go));
}

static clockid_t clock_of(const struct timespec *at) { return at->tv_sec > DATED_S ? CLOCK_REALTIME : CLOCK_MONOTONIC; }

int clock_gettime(clockid_t clock, struct timespec *t) {
    begin();
    int failed = real_gettime(clock, t);
    if (!failed && slowed(clock)) *t = spec(ns(t) - lag_ns());
    return failed;
}

int gettimeofday(struct timeval *restrict t, void *restrict zone) {
    (void)zone;
    begin();
    int64_t at = moment(CLOCK_REALTIME);
    *t = (struct timeval){at / NS, at % NS / 1000};
    return 0;
}

time_t time(time_t *t) {
    begin();
    time_t at = moment(CLOCK_REALTIME) / NS;
    if (t) *t = at;
    return at;
}

int clock_nanosleep(clockid_t clock, int flags, const struct timespec *wish, struct timespec *left) {
    begin();
    if (!slowed(clock) || wish->tv_nsec < 0 || wish->tv_nsec >= NS || wish->tv_sec < 0)
        return real_nanosleep(clock, flags, wish, left);
    int64_t until = ns(wish) + (flags & TIMER_ABSTIME ? 0 : moment(clock)), to_go;
    while ((to_go = until - moment(clock)) > 0) {
        int64_t real_ns = (int64_t)(to_go / rate()) + 1;
        struct timespec part = spec(real_ns < SLICE_NS ? real_ns : SLICE_NS);
        int failed = real_nanosleep(CLOCK_MONOTONIC, 0, &part, NULL);
        if (failed) {
            if (left && !(flags & TIMER_ABSTIME)) *left = spec(until - moment(clock));
            return failed;
        }
    }
    return 0;
}

int nanosleep(const struct timespec *wish, struct timespec *left) {
    int failed = clock_nanosleep(CLOCK_MONOTONIC, 0, wish, left);
    if (failed) errno = failed;
    return failed ? -1 : 0;
}

int usleep(useconds_t us) {
    struct timespec wish = spec((int64_t)us * 1000);
    return nanosleep(&wish, NULL);
}

unsigned int sleep(unsigned int s) {
    struct timespec wish = {s, 0}, left = {0, 0};
    return nanosleep(&wish, &left) == 0 ? 0 : (unsigned int)(left.tv_sec + (left.tv_nsec >= NS / 2));
}

/* Waits for files end at the moment that they were to end at, however the rate changes meanwhile. Negative: never. */
static int64_t end_of(int64_t wait_ns) { return wait_ns < 0 ? -1 : moment(CLOCK_MONOTONIC) + wait_ns; }

static int64_t real_ns_until(int64_t end_ns) {
    int64_t to_go = end_ns - moment(CLOCK_MONOTONIC);
    return to_go > 0 ? (int64_t)(to_go / rate()) + 1 : 0;
}

static int real_ms_until(int64_t end_ns) {
    if (end_ns < 0) return -1;
    int64_t ms = (real_ns_until(end_ns) + NS / 1000 - 1) / (NS / 1000);
    return ms > 1000000000 ? 1000000000 : (int)ms;
}

static int over(int64_t end_ns) { return end_ns >= 0 && moment(CLOCK_MONOTONIC) >= end_ns; }

int poll(struct pollfd *files, nfds_t count, int ms) {
    begin();
    int64_t end_ns = end_of(ms < 0 ? -1 : ms * (NS / 1000));
    int found;
    while ((found = real_poll(files, count, real_ms_until(end_ns))) == 0 && !over(end_ns)) continue;
    return found;
}

int ppoll(struct pollfd *files, nfds_t count, const struct timespec *wait, const sigset_t *mask) {
    begin();
    int64_t end_ns = end_of(wait ? ns(wait) : -1);
    int found;
    do {
        struct timespec longer = spec(wait ? real_ns_until(end_ns) : 0);
        found = real_ppoll(files, count, wait ? &longer : NULL, mask);
    } while (found == 0 && !over(end_ns));
    return found;
}

int epoll_wait(int file, struct epoll_event *events, int most, int ms) {
    begin();
    int64_t end_ns = end_of(ms < 0 ? -1 : ms * (NS / 1000));
    int found;
    while ((found = real_epoll(file, events, most, real_ms_until(end_ns))) == 0 && !over(end_ns)) continue;
    return found;
}

int epoll_pwait(int file, struct epoll_event *events, int most, int ms, const sigset_t *mask) {
    begin();
    int64_t end_ns = end_of(ms < 0 ? -1 : ms * (NS / 1000));
    int found;
    while ((found = real_epoll_p(file, events, most, real_ms_until(end_ns), mask)) == 0 && !over(end_ns)) continue;
    return found;
}

static int selected(int count, fd_set *sets[3], int64_t end_ns, const sigset_t *mask) {
    fd_set wished[3];
    for (int i = 0; i < 3; i++)
        if (sets[i]) wished[i] = *sets[i];
    for (;;) {
        struct timespec longer = spec(end_ns < 0 ? 0 : real_ns_until(end_ns));
        int found = real_pselect(count, sets[0], sets[1], sets[2], end_ns < 0 ? NULL : &longer, mask);
        if (found != 0 || over(end_ns)) return found;
        for (int i = 0; i < 3; i++)
            if (sets[i]) *sets[i] = wished[i];
    }
}

int select(int count, fd_set *readable, fd_set *writable, fd_set *other, struct timeval *wait) {
    begin();
    fd_set *sets[3] = {readable, writable, other};
    int64_t end_ns = end_of(wait ? wait->tv_sec * NS + wait->tv_usec * 1000LL : -1);
    int found = selected(count, sets, end_ns, NULL);
    if (wait) { /* as Linux does: what is left of it */
        struct timespec left = spec(end_ns - moment(CLOCK_MONOTONIC));
        *wait = (struct timeval){left.tv_sec, left.tv_nsec / 1000};
    }
    return found;
}

int pselect(int count, fd_set *readable, fd_set *writable, fd_set *other, const struct timespec *wait,
            const sigset_t *mask) {
    begin();
    fd_set *sets[3] = {readable, writable, other};
    return selected(count, sets, end_of(wait ? ns(wait) : -1), mask);
}

int sem_clockwait(sem_t *semaphore, clockid_t clock, const struct timespec *at) {
    begin();
    for (;;) {
        struct timespec real_at = real_moment(clock, at);
        int failed = real_sem_clock(semaphore, clock, &real_at);
        if (!failed || errno != ETIMEDOUT || moment(clock) >= ns(at)) return failed;
    }
}

int sem_timedwait(sem_t *semaphore, const struct timespec *at) {
    begin();
    for (;;) {
        struct timespec real_at = real_moment(CLOCK_REALTIME, at);
        int failed = real_sem(semaphore, &real_at);
        if (!failed || errno != ETIMEDOUT || moment(CLOCK_REALTIME) >= ns(at)) return failed;
    }
}

/* Too early, by a change of rate or a halt: a condition may wake for no reason, and who waits looks again. */
static int woken(int failed, clockid_t clock, const struct timespec *at) {
    return failed == ETIMEDOUT && moment(clock) < ns(at) ? 0 : failed;
}

int pthread_cond_timedwait(pthread_cond_t *condition, pthread_mutex_t *mutex, const struct timespec *at) {
    begin();
    clockid_t clock = clock_of(at);
    struct timespec real_at = real_moment(clock, at);
    return woken(real_cond(condition, mutex, &real_at), clock, at);
}

int pthread_cond_clockwait(pthread_cond_t *condition, pthread_mutex_t *mutex, clockid_t clock,
                           const struct timespec *at) {
    begin();
    struct timespec real_at = real_moment(clock, at);
    return woken(real_cond_clock(condition, mutex, clock, &real_at), clock, at);
}
