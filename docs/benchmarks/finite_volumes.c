// SPDX-FileCopyrightText: 2026 lava_ros contributors
// SPDX-License-Identifier: Apache-2.0

#include <immintrin.h>
#include <stdlib.h>

// The plainest scheme for h_t = div(k h^3 grad(h + z)) + source, k = rho g / 3 mu: explicit Euler
// steps, central fluxes between square cells, closed borders. codes.py compiles and runs it.

#define SMALLER(a, b) ((a) < (b) ? (a) : (b))
#define LARGER(a, b) ((a) > (b) ? (a) : (b))

// Thickness below which a cell does not widen the window [m].
#define DRY 1e-6f

#define MAX_STAGES 99

// Thickness that leaves a for b: h^3 is its mean over the two thicknesses, the giver keeps 3/4.
static inline double passed(double a, double b, double fall, double rate) {
  double amount = 0.25 * rate * (a + b) * (a * a + b * b) * fall;
  return LARGER(SMALLER(amount, 0.25 * a), -0.25 * b);
}

// Advances h to a time and returns the steps. box: first and last row and column with a source;
// change: zeros; share: of the stable step, at most 1.
long advance(double *h, double *change, const double *z, const double *source, const long *box,
             long rows, long columns, double cell, double k, double share, double until) {
  double time = 0.0, thickest = 0.0;
  long steps = 0, wet[4] = {box[0], box[1], box[2], box[3]};
  for (; time < until; steps++) {
    double step = share * cell * cell / (4.0 * k * thickest * thickest * thickest + 1e-9);
    step = SMALLER(SMALLER(step, 1e-3 * until), until - time);
    double rate = k * step / (cell * cell);
    long top = LARGER(wet[0] - 1, 0), bottom = SMALLER(wet[1] + 1, rows - 1);
    long left = LARGER(wet[2] - 1, 0), right = SMALLER(wet[3] + 1, columns - 1);
    for (long i = top; i <= bottom; i++)
      for (long j = left; j <= right; j++)
        for (int n = 0; n < 2; n++) {
          long p = i * columns + j, q = p + (n ? columns : 1);
          if (n ? i == bottom : j == right) continue;
          double amount = passed(h[p], h[q], h[p] + z[p] - h[q] - z[q], rate);
          change[p] -= amount;
          change[q] += amount;
        }
    thickest = 0.0;
    for (long i = top; i <= bottom; i++)
      for (long j = left; j <= right; j++) {
        long p = i * columns + j;
        h[p] += change[p] + step * source[p];
        change[p] = 0.0;
        if (h[p] <= 0.0) continue;
        thickest = LARGER(thickest, h[p]);
        wet[0] = SMALLER(wet[0], i), wet[1] = LARGER(wet[1], i);
        wet[2] = SMALLER(wet[2], j), wet[3] = LARGER(wet[3], j);
      }
    time += step;
  }
  return steps;
}

// The same equation and fluxes in a better scheme: steps of several stages (RKL2: Meyer, Balsara &
// Aslam 2014, doi:10.1016/j.jcp.2013.08.021), rows of float32 that the compiler vectorises, and
// subnormal numbers set to 0. float64 only sums the changes of all steps.

// Cells of a window, and constants of all flows: k over the area of a cell, and the largest part of
// a cell's thickness that a flow takes in a second.
typedef struct {
  long top, bottom, left, right, columns;
  float k, most;
} Window;

// Thickness a second that leaves a for b. Stages may overdraw a cell, which then only receives.
static inline float flow(float a, float b, float drop, float factor, const Window *w) {
  const float fall = a - b + drop;
  a = LARGER(a, 0.0f), b = LARGER(b, 0.0f);
  float amount = 0.25f * w->k * factor * (a + b) * (a * a + b * b) * fall;
  return LARGER(SMALLER(amount, w->most * a), -w->most * b);
}

// Displacement a second, in cells, longer where the surface falls by more than the thickness:
// central fluxes are stable there only in shorter steps.
static inline float pace(float a, float b, float drop, float amount) {
  const float fall = a - b + drop;
  const float part = 2.0f / (LARGER(a, 0.0f) + LARGER(b, 0.0f) + 1e-3f);
  return (amount < 0.0f ? -amount : amount) * part * (1.0f + part * (fall < 0.0f ? -fall : fall));
}

// Drops of the ground and factors of k between a cell and the next one along a row and a column.
typedef struct {
  const float *along, *across, *factor_along, *factor_across, *source;
} Ground;

// Writes the change of h a second. Returns the largest displacement a second, in cells, if paced;
// inline, so that there is code without it.
static inline __attribute__((always_inline)) float changes(
    float *restrict change, const float *restrict h, const Ground *g, Window w,
    float *restrict beside, float *restrict below, int paced) {
  float fastest = 0.0f;
  for (long j = w.left; j <= w.right; j++) below[j] = 0.0f;
  for (long i = w.top; i <= w.bottom; i++) {
    const long row = i * w.columns;
    const float *restrict a = h + row, *restrict b = h + row + w.columns;
    float *restrict out = change + row;
    beside[w.left] = beside[w.right + 1] = 0.0f;
    for (long j = w.left; j < w.right; j++) {
      float drop = g->along[row + j];
      float amount = flow(a[j], a[j + 1], drop, g->factor_along[row + j], &w);
      if (paced) fastest = LARGER(fastest, pace(a[j], a[j + 1], drop, amount));
      beside[j + 1] = amount;
    }
    for (long j = w.left; j <= w.right; j++)
      out[j] = g->source[row + j] + beside[j] - beside[j + 1] + below[j];
    if (i == w.bottom) continue;
    for (long j = w.left; j <= w.right; j++) {
      float drop = g->across[row + j];
      float amount = flow(a[j], b[j], drop, g->factor_across[row + j], &w);
      if (paced) fastest = LARGER(fastest, pace(a[j], b[j], drop, amount));
      out[j] -= amount;
      below[j] = amount;
    }
  }
  return fastest;
}

// Stable step of a number of stages, over that of an Euler step.
static double reach(long stages) { return 0.9 * 0.25 * (stages * stages + stages - 2); }

// Advances h to a time and returns the evaluations of the flows. box: as in advance; displacement:
// the largest in a step, in cells; peak: the largest thickness so far.
long advance_in_stages(double *h, float *peak, const Ground *ground, const long *box, long rows,
                       long columns, double cell, double k, double displacement, double until) {
  const unsigned int former = _mm_getcsr();
  _mm_setcsr(former | 0x8040);
  const size_t count = rows * columns;
  float *work = calloc(5 * count + 2 * columns + 2, sizeof(float));
  // thickness at a stage, its change a second there and at the start, and since the start
  float *y = work, *change = y + count, *first = change + count, *newer = first + count;
  float *older = newer + count, *beside = older + count, *below = beside + columns + 1;
  double time = 0.0, thickest = 0.0, poured = 0.0, step = 1e-3 * until;
  long evaluations = 0, wet[4] = {box[0], box[1], box[2], box[3]};
  for (size_t p = 0; p < count; p++) {
    poured = LARGER(poured, ground->source[p]);
    y[p] = h[p];
  }
  while (time < until) {
    // lava moves by less than two cells in a step
    Window w = {LARGER(wet[0] - 2, 0), SMALLER(wet[1] + 2, rows - 1), LARGER(wet[2] - 2, 0),
                SMALLER(wet[3] + 2, columns - 1), columns, k / (cell * cell), 0.0f};
    const double thick = thickest + poured * step;
    const double stiffness = 4.0 * w.k * thick * thick * thick + 1e-30;
    w.most = 0.25 * stiffness;
    const double fastest = changes(first, y, ground, w, beside, below, 1);
    step = SMALLER(SMALLER(displacement / (fastest + 1e-30), 1.5 * step), 5e-3 * until);
    step = SMALLER(step, until - time);
    // each stage takes 0.9 of the largest stable step
    long stages = 3;
    while (stages < MAX_STAGES && reach(stages) < step * stiffness) stages += 2;
    step = SMALLER(step, reach(stages) / stiffness);
    evaluations += stages;
    const double w1 = 4.0 / (stages * stages + stages - 2);
    double b = 1.0 / 3.0, former_b = b;
    for (long n = 1; n <= stages; n++) {
      const double next_b = n == 1 ? b : (n * n + n - 2) / (2.0 * n * (n + 1));
      const double mu = n == 1 ? 0.0 : (2 * n - 1) * next_b / (n * b);
      const float m = mu, v = n == 1 ? 0.0 : -(n - 1) * next_b / (n * former_b);
      const float here = n == 1 ? 0.0 : mu * w1 * step;
      const float start = n == 1 ? b * w1 * step : -(1.0 - b) * mu * w1 * step;
      if (n > 1) changes(change, y, ground, w, beside, below, 0);
      for (long i = w.top; i <= w.bottom; i++) {
        const long row = i * columns;
        float *restrict to = older + row, *restrict at = y + row;
        const float *restrict from = newer + row, *restrict c = change + row;
        const float *restrict c0 = first + row;
        const double *restrict whole = h + row;
        for (long j = w.left; j <= w.right; j++) {
          to[j] = (n == 1 ? 0.0f : m * from[j] + v * to[j] + here * c[j]) + start * c0[j];
          at[j] = (float)whole[j] + to[j];
        }
      }
      float *swap = newer;
      newer = older, older = swap;
      former_b = b, b = next_b;
      if (n == 1)
        for (long i = w.top; i <= w.bottom; i++)
          for (long j = w.left; j <= w.right; j++) older[i * columns + j] = 0.0f;
    }
    thickest = 0.0;
    for (long i = w.top; i <= w.bottom; i++) {
      const long row = i * columns;
      float most = 0.0f;
      for (long j = w.left; j <= w.right; j++) {
        h[row + j] += newer[row + j];
        y[row + j] = h[row + j];
        peak[row + j] = LARGER(peak[row + j], y[row + j]);
        most = LARGER(most, y[row + j]);
      }
      if (most <= DRY) continue;
      long from = w.left, to = w.right;
      while (y[row + from] <= DRY) from++;
      while (y[row + to] <= DRY) to--;
      thickest = LARGER(thickest, most);
      wet[0] = SMALLER(wet[0], i), wet[1] = LARGER(wet[1], i);
      wet[2] = SMALLER(wet[2], from), wet[3] = LARGER(wet[3], to);
    }
    time += step;
  }
  free(work);
  _mm_setcsr(former);
  return evaluations;
}
