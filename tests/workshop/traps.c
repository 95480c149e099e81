// A trap on every instruction of some functions of this process. One that is reached is taken away, and remembered.
#define _GNU_SOURCE
#include <signal.h>
#include <string.h>
#include <sys/mman.h>
#include <ucontext.h>
#include <unistd.h>

static unsigned char *base, *right, *armed, *hits;
static long low, size;

static void reached(int signal, siginfo_t *information, void *context) {
  greg_t *place = &((ucontext_t *)context)->uc_mcontext.gregs[REG_RIP];
  long at = *place - 1 - (long)base - low;
  if (at < 0 || at >= size) _exit(70);  // a trap of somebody else
  base[low + at] = right[at];
  hits[at] = 1;
  --*place;
}

// BASE: where the library's file begins in memory; ONE, OTHER: SIZE bytes from LOW on, as they are and with the traps.
int prepare(unsigned char *where, long from, long bytes, unsigned char *one, unsigned char *other, unsigned char *hit) {
  struct sigaction action = {.sa_sigaction = reached, .sa_flags = SA_SIGINFO};
  long page = sysconf(_SC_PAGESIZE), begin = ((long)where + from) / page * page;
  base = where, low = from, size = bytes, right = one, armed = other, hits = hit;
  return sigaction(SIGTRAP, &action, 0) || memcmp(where + from, one, bytes) ||
         mprotect((void *)begin, (long)where + from + bytes - begin, PROT_READ | PROT_WRITE | PROT_EXEC);
}

void arm(void) { memset(hits, 0, size), memcpy(base + low, armed, size); }
void disarm(void) { memcpy(base + low, right, size); }
