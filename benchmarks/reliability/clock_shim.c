/* A machine's clock that steps on command, for the processes that load this library (LD_PRELOAD).
 *
 * STEPPED_CLOCK names a file of 8 bytes: nanoseconds, signed, that are added to whatever tells the
 * time of day. Monotonic clocks are left alone. Waits until a time of day wait by the stepped clock
 * too, as in the kernel: a step ends them early, or late.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#define SECOND 1000000000LL
/* A wait is looked at again after this: a step in the middle of it takes effect so late. */
#define SLICE (SECOND / 50)
/* Deadlines below this many seconds are of a monotonic clock: times of day are past 2001. */
#define TIME_OF_DAY 1000000000LL
#define NEXT(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))

static _Atomic int64_t none, *offset;

static int64_t stepped_by(void) {
  if (!offset) {
    const char *path = getenv("STEPPED_CLOCK");
    int file = path ? open(path, O_RDONLY | O_CLOEXEC) : -1;
    void *found = file < 0 ? MAP_FAILED : mmap(NULL, 8, PROT_READ, MAP_SHARED, file, 0);
    offset = found == MAP_FAILED ? &none : found;
    if (file >= 0) close(file);
  }
  return *offset;
}

static struct timespec plus(struct timespec t, int64_t ns) {
  int64_t all = t.tv_sec * SECOND + t.tv_nsec + ns;
  if (all < 0) all = 0;
  return (struct timespec){all / SECOND, all % SECOND};
}

int clock_gettime(clockid_t id, struct timespec *t) {
  static int (*real)(clockid_t, struct timespec *);
  if (!real) real = NEXT(clock_gettime);
  int code = real(id, t);
  int steps = id == CLOCK_REALTIME || id == CLOCK_REALTIME_COARSE || id == CLOCK_TAI;
  if (!code && steps) *t = plus(*t, stepped_by());
  return code;
}

int gettimeofday(struct timeval *restrict t, void *restrict zone) {
  struct timespec now;
  clock_gettime(CLOCK_REALTIME, &now);
  *t = (struct timeval){now.tv_sec, now.tv_nsec / 1000};
  (void)zone;
  return 0;
}

time_t time(time_t *t) {
  struct timespec now;
  clock_gettime(CLOCK_REALTIME, &now);
  if (t) *t = now.tv_sec;
  return now.tv_sec;
}

int timespec_get(struct timespec *t, int base) {
  return base == TIME_UTC && !clock_gettime(CLOCK_REALTIME, t) ? base : 0;
}

/* Return the kernel's time of a deadline, or of the next look if that comes first. */
static struct timespec until(const struct timespec *deadline, int *whole) {
  struct timespec now;
  *whole = 1;
  if (deadline->tv_sec < TIME_OF_DAY) return *deadline;
  clock_gettime(CLOCK_REALTIME, &now);
  struct timespec look = plus(now, SLICE);
  *whole = deadline->tv_sec < look.tv_sec ||
           (deadline->tv_sec == look.tv_sec && deadline->tv_nsec <= look.tv_nsec);
  return plus(*whole ? *deadline : look, -stepped_by());
}

/* A look is a spurious wake-up, which a condition's waiter must expect. */
int pthread_cond_timedwait(pthread_cond_t *restrict c, pthread_mutex_t *restrict m,
                           const struct timespec *restrict deadline) {
  static __typeof__(&pthread_cond_timedwait) real;
  /* An unversioned look-up may find the one that LinuxThreads had, on x86-64. */
  if (!real) real = dlvsym(RTLD_NEXT, "pthread_cond_timedwait", "GLIBC_2.3.2");
  if (!real) real = NEXT(pthread_cond_timedwait);
  int whole;
  struct timespec at = until(deadline, &whole);
  int code = real(c, m, &at);
  return code == ETIMEDOUT && !whole ? 0 : code;
}

int pthread_cond_clockwait(pthread_cond_t *c, pthread_mutex_t *m, clockid_t id,
                           const struct timespec *deadline) {
  static __typeof__(&pthread_cond_clockwait) real;
  if (!real) real = NEXT(pthread_cond_clockwait);
  int whole = 1;
  struct timespec at = id == CLOCK_REALTIME ? until(deadline, &whole) : *deadline;
  int code = real(c, m, id, &at);
  return code == ETIMEDOUT && !whole ? 0 : code;
}

int sem_timedwait(sem_t *restrict s, const struct timespec *restrict deadline) {
  static __typeof__(&sem_timedwait) real;
  if (!real) real = NEXT(sem_timedwait);
  for (;;) {
    int whole;
    struct timespec at = until(deadline, &whole);
    if (!real(s, &at)) return 0;
    if (errno != ETIMEDOUT || whole) return -1;
  }
}

int pthread_mutex_timedlock(pthread_mutex_t *restrict m, const struct timespec *restrict deadline) {
  static __typeof__(&pthread_mutex_timedlock) real;
  if (!real) real = NEXT(pthread_mutex_timedlock);
  for (;;) {
    int whole;
    struct timespec at = until(deadline, &whole);
    int code = real(m, &at);
    if (code != ETIMEDOUT || whole) return code;
  }
}

int clock_nanosleep(clockid_t id, int flags, const struct timespec *t, struct timespec *left) {
  static __typeof__(&clock_nanosleep) real;
  if (!real) real = NEXT(clock_nanosleep);
  if (id != CLOCK_REALTIME || !(flags & TIMER_ABSTIME)) return real(id, flags, t, left);
  for (;;) {
    int whole;
    struct timespec at = until(t, &whole);
    int code = real(id, flags, &at, left);
    if (code || whole) return code;
  }
}
