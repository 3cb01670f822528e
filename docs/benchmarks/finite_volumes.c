// SPDX-FileCopyrightText: 2026 lava_ros contributors
// SPDX-License-Identifier: Apache-2.0

// The plainest scheme for h_t = div(k h^3 grad(h + z)) + source, k = rho g / 3 mu: explicit Euler
// steps, central fluxes between square cells, closed borders. codes.py compiles and runs it.

#define SMALLER(a, b) ((a) < (b) ? (a) : (b))
#define LARGER(a, b) ((a) > (b) ? (a) : (b))

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
