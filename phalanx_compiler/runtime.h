/* What all compiled kernels stand on: arrays, checks that unwind to the caller, and scratch memory.

   A violated check never returns: it unwinds to the frame of the call from Python, or of the kernel that reads a
   peer's bytes. Kernels own no resources but scratch memory, which belongs to the frame. The enum of violations is
   generated (violations.py) and stands before this file. */

#include <math.h>
#include <setjmp.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

typedef union { int64_t i; uint64_t u; double d; const char *p; } word;
typedef struct { char *p; int64_t n0; } arr1;
typedef struct { char *p; int64_t n0, n1; } arr2;
typedef struct { char *p; int64_t n0, n1, n2; } arr3;
typedef struct { char *p; int64_t n0, n1, n2, n3; } arr4;
typedef struct { const char *file; int32_t line; } site;

enum { FIRST_BLOCK = 8192, BLOCK = 1 << 16 };
#define SCRATCH_MOST (INT64_C(1) << 28)

struct block { struct block *before; } __attribute__((aligned(16))); /* so that arrays behind it are, too */
struct mark { struct block *last; char *at, *end; int64_t taken; };
struct fault { const char *file; int32_t line, what; int64_t index, size; };
struct frame {
    jmp_buf jump;
    struct frame *outer;
    struct mark scratch;
    struct fault fault;
    char first[FIRST_BLOCK];
};

static __thread struct frame *top;
static const site *site_of(int32_t at);

#define UNLIKELY(x) __builtin_expect((x), 0)
#define UNUSED __attribute__((unused))
#define COLD __attribute__((noreturn, noinline, cold))

COLD static void violate(int32_t at, int32_t what, int64_t index, int64_t size)
{
    top->fault = (struct fault){site_of(at)->file, site_of(at)->line, what, index, size};
    longjmp(top->jump, 1);
}

/* --- scratch memory --- */

UNUSED static void release(struct mark *scratch, const struct mark *until)
{
    while (scratch->last != until->last) {
        struct block *block = scratch->last;
        scratch->last = block->before;
        free(block);
    }
    *scratch = *until;
}

UNUSED static char *scratch(int64_t size, int32_t at)
{
    struct mark *s = &top->scratch;
    size = (size + 15) & ~INT64_C(15);
    if (UNLIKELY(size > s->end - s->at)) {
        int64_t most = size > BLOCK ? size : BLOCK;
        struct block *block = s->taken + most <= SCRATCH_MOST ? malloc(sizeof *block + (size_t)most) : NULL;
        if (block == NULL) violate(at, BAD_SCRATCH, s->taken + most, SCRATCH_MOST);
        block->before = s->last;
        s->last = block;
        s->at = (char *)(block + 1);
        s->end = s->at + most;
        s->taken += most;
    }
    s->at += size;
    return s->at - size;
}

UNUSED static int64_t scratch_size(int64_t n0, int64_t n1, int64_t n2, int64_t n3, int64_t each, int32_t at)
{
    int64_t size = each, n[4] = {n0, n1, n2, n3};
    for (int k = 0; k < 4; k++) {
        if (n[k] < 0 || n[k] > SCRATCH_MOST) violate(at, BAD_SIZE, n[k], SCRATCH_MOST);
        size *= n[k];
        if (size > SCRATCH_MOST) violate(at, BAD_SCRATCH, size, SCRATCH_MOST);
    }
    return size;
}

UNUSED static void enter(struct frame *f)
{
    f->outer = top;
    f->scratch = (struct mark){NULL, f->first, f->first + FIRST_BLOCK, 0};
    top = f;
}

UNUSED static void leave(struct frame *f)
{
    struct mark none = {NULL, f->first, f->first + FIRST_BLOCK, 0};
    release(&f->scratch, &none);
    top = f->outer;
}

/* Violations while a peer's bytes were read: its message was rejected, and Python logs them after the call. */
enum { DEFECTS_KEPT = 16 };
static struct defects {
    char lock;
    int32_t count;                               /* places in the source */
    struct { struct fault fault; int64_t times; } at[DEFECTS_KEPT]; /* the last place takes what finds no other */
} defects;

UNUSED static void reject(struct frame *f)
{
    int32_t k = 0;
    while (__atomic_test_and_set(&defects.lock, __ATOMIC_ACQUIRE)) continue;
    while (k < defects.count && (defects.at[k].fault.line != f->fault.line || defects.at[k].fault.file != f->fault.file)) k++;
    if (k == defects.count && k < DEFECTS_KEPT) {
        defects.at[k].fault = f->fault;
        defects.at[k].times = 0;
        __atomic_store_n(&defects.count, k + 1, __ATOMIC_RELAXED);
    }
    defects.at[k < DEFECTS_KEPT ? k : DEFECTS_KEPT - 1].times++;
    __atomic_clear(&defects.lock, __ATOMIC_RELEASE);
    leave(f);
}

/* --- kernels of other libraries, called by an address in a table (own.py) --- */

UNUSED static __thread int32_t caller; /* in a user's file: where it has called a kernel of the package last */

COLD UNUSED static void pass_on(const struct fault *f)
{
    top->fault = *f;
    longjmp(top->jump, 1);
}
UNUSED static void *linked_at(void *const *table, int64_t which, int64_t most, int32_t at)
{
    void *found = table != NULL && which >= 0 && which < most ? table[which] : NULL;
    if (UNLIKELY(found == NULL)) violate(at, BAD_LINK, which, most);
    return found;
}

/* --- checks --- */

static inline int64_t within(int64_t i, int64_t n, int32_t at)
{
    if (UNLIKELY((uint64_t)i >= (uint64_t)n)) violate(at, BAD_INDEX, i, n);
    return i;
}
static inline void room(arr1 row, int64_t begin, int64_t length, int32_t at)
{
    if (UNLIKELY(begin < 0 || length < 0 || begin > row.n0 || length > row.n0 - begin))
        violate(at, BAD_INDEX, begin < 0 || begin > row.n0 ? begin : begin + length - 1, row.n0);
}
/* The same for a length above 0, in two comparisons. */
static inline void room_for(arr1 row, int64_t begin, int64_t length, int32_t at)
{
    if (UNLIKELY((uint64_t)begin >= (uint64_t)row.n0 || length > row.n0 - begin))
        violate(at, BAD_INDEX, begin < 0 || begin > row.n0 ? begin : begin + length - 1, row.n0);
}
static inline void alike(int64_t n, int64_t m, int32_t at)
{
    if (UNLIKELY(n != m)) violate(at, BAD_SHAPE, m, n);
}
static inline int64_t divisor(int64_t n, int32_t at)
{
    if (UNLIKELY(n == 0)) violate(at, BAD_DIVISOR, 0, 0);
    return n;
}
static inline int64_t to_int(double x, int32_t at)
{
    if (UNLIKELY(!(x >= -0x1p63 && x < 0x1p63))) violate(at, BAD_NUMBER, 0, 0);
    return (int64_t)x;
}

/* --- numbers: as Python has them --- */

static inline double as_double(int64_t w) { double d; memcpy(&d, &w, 8); return d; }
static inline float f32_of(uint32_t w) { float f; memcpy(&f, &w, 4); return f; }
static inline uint32_t u32_of(float f) { uint32_t w; memcpy(&w, &f, 4); return w; }
/* The least number divided by -1 wraps, as all else does: the processor would stop the program. */
static inline int64_t floordiv(int64_t a, int64_t b)
{
    if (UNLIKELY(b == -1)) return (int64_t)(0 - (uint64_t)a);
    int64_t q = a / b;
    return q - ((a % b != 0) & ((a ^ b) < 0));
}
static inline int64_t floormod(int64_t a, int64_t b)
{
    if (UNLIKELY(b == -1)) return 0;
    int64_t r = a % b;
    return r + ((r != 0) & ((r ^ b) < 0) ? b : 0);
}
static inline int64_t abs_i(int64_t a) { return a < 0 ? (int64_t)(0 - (uint64_t)a) : a; }
/* How often a loop over range(low, high, step) runs. */
static inline uint64_t steps(int64_t low, int64_t high, int64_t step)
{
    uint64_t up = (uint64_t)high - (uint64_t)low, down = (uint64_t)low - (uint64_t)high;
    if (step > 0) return low < high ? (up - 1) / (uint64_t)step + 1 : 0;
    return low > high ? (down - 1) / (0 - (uint64_t)step) + 1 : 0;
}
static inline double floormod_d(double a, double b)
{
    double r = fmod(a, b);
    if (r != 0.0) return (b < 0.0) != (r < 0.0) ? r + b : r;
    return copysign(0.0, b);
}
static inline double floordiv_d(double a, double b)
{
    double r = fmod(a, b), q = (a - r) / b;
    if (r != 0.0 && (b < 0.0) != (r < 0.0)) q -= 1.0;
    if (q == 0.0) return copysign(0.0, a / b);
    double whole = floor(q);
    return q - whole > 0.5 ? whole + 1.0 : whole;
}
static inline int64_t min_i(int64_t a, int64_t b) { return b < a ? b : a; }
static inline int64_t max_i(int64_t a, int64_t b) { return b > a ? b : a; }
static inline uint64_t min_u(uint64_t a, uint64_t b) { return b < a ? b : a; }
static inline uint64_t max_u(uint64_t a, uint64_t b) { return b > a ? b : a; }
static inline double min_d(double a, double b) { return b < a ? b : a; }
static inline double max_d(double a, double b) { return b > a ? b : a; }

/* --- rows of bytes --- */

#define LOAD_STORE(bits, T) \
    static inline int64_t load_##bits(arr1 row, int64_t i, int32_t at) \
    { T x; room_for(row, i, bits / 8, at); memcpy(&x, row.p + i, bits / 8); return (int64_t)x; } \
    static inline void store_##bits(arr1 row, int64_t i, int64_t value, int32_t at) \
    { T x = (T)value; room_for(row, i, bits / 8, at); memcpy(row.p + i, &x, bits / 8); }
LOAD_STORE(16, uint16_t)
LOAD_STORE(32, uint32_t)
LOAD_STORE(64, uint64_t)
/* Packets and entries have 16 to 64 bytes, for which a call of memmove takes longer than the move. All is read first. */
typedef struct { uint64_t words[2]; } two_words;
static inline void move_short(char *to, const char *from, size_t length)
{
    two_words a, b, c, d;
    memcpy(&a, from, 16);
    memcpy(&b, from + length - 16, 16);
    if (length > 32) {
        memcpy(&c, from + 16, 16);
        memcpy(&d, from + length - 32, 16);
        memcpy(to + 16, &c, 16);
        memcpy(to + length - 32, &d, 16);
    }
    memcpy(to, &a, 16);
    memcpy(to + length - 16, &b, 16);
}
static inline void move_bytes(arr1 to, int64_t to_at, arr1 from, int64_t from_at, int64_t length, int32_t at)
{
    room(to, to_at, length, at);
    room(from, from_at, length, at);
    if (length >= 16 && length <= 64) move_short(to.p + to_at, from.p + from_at, (size_t)length);
    else memmove(to.p + to_at, from.p + from_at, (size_t)length);
}
static inline bool equal_bytes(arr1 a, int64_t a_at, arr1 b, int64_t b_at, int64_t length, int32_t at)
{
    room(a, a_at, length, at);
    room(b, b_at, length, at);
    return memcmp(a.p + a_at, b.p + b_at, (size_t)length) == 0;
}
/* Lines of a cache that are read soon; nothing is read now, so no place is wrong. */
static inline void prefetch(const char *rows, int64_t begin, int64_t length)
{
    for (int64_t at = 0; at < length; at += 64)
        __builtin_prefetch((const void *)((uintptr_t)rows + (uintptr_t)(begin + at)), 0, 3);
    __asm__ volatile(""); /* gcc deletes calls of functions that do nothing else */
}
/* As Python cuts: ends beyond the array are its ends, negative ones count from behind. */
static inline int64_t cut(int64_t i, int64_t n) { if (i < 0) i += n; return i < 0 ? 0 : i > n ? n : i; }
static inline int64_t cut_length(int64_t low, int64_t high) { return high > low ? high - low : 0; }
