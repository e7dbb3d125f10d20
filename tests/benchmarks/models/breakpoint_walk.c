/* The static inverse in C, for comparison: the same breakpoint walk and saturation inverse. */
#include <math.h>

static double poly(const double *c, int m, double z) {
    double y = 0.0;
    for (int j = m - 1; j >= 0; j--) y = y * z + c[j];
    return y;
}

static double slope_at(const double *c, int m, double z) {
    double s = 0.0;
    for (int j = m - 1; j > 0; j--) s = s * z + j * c[j];
    return s;
}

static double unsaturate(const double *c, int m, const double *knots, int k, double y_first,
                         double y_last, double y) {
    double position = (y - y_first) / (y_last - y_first) * (k - 1);
    if (position <= 0.0) return knots[0];
    if (position >= k - 1) return knots[k - 1];
    if (m == 2) return (y - c[0]) / c[1];
    int j = (int)position;
    double lo = knots[j], hi = knots[j + 1], z = 0.5 * (lo + hi);
    int rising = y_last > y_first;
    for (int i = 0; i < 100; i++) {
        double error = poly(c, m, z) - y;
        if (error == 0.0) break;
        if ((error > 0.0) == rising) hi = z; else lo = z;
        double gradient = slope_at(c, m, z);
        double next = gradient != 0.0 ? z - error / gradient : lo - 1.0;
        if (!(lo <= next && next <= hi)) next = 0.5 * (lo + hi);
        double moved = fabs(next - z);
        z = next;
        if (moved <= 2.3e-16 * fmax(fabs(z), 1e-3 * (fabs(lo) + fabs(hi)))) break;
    }
    return z;
}

void invert(const double *r, const double *b, int n, const double *c, int m, const double *knots,
            int k, double y_first, double y_last, double v_min, double v_max, double *h,
            const double *y, double *u, int samples) {
    double last = 0.0;
    for (int t = 0; t < samples; t++) {
        double rest = unsaturate(c, m, knots, k, y_first, y_last, y[t]);
        double total = 0.0, v = last, slope = 0.0;
        for (int i = 0; i < n; i++) { rest -= b[i] * h[i]; total += b[i]; }
        int found = rest == 0.0, up = (rest > 0.0) == (total > 0.0);
        for (int i = 0; i < n && !found; i++) {
            double corner = up ? h[i] + r[i] : h[i] - r[i];
            if (up ? corner > v : corner < v) {
                if (up ? v_max < corner : v_min > corner) corner = up ? v_max : v_min;
                double part = slope * (corner - v);
                if (slope != 0.0 && fabs(part) >= fabs(rest)) { v += rest / slope; found = 1; break; }
                if (up ? corner >= v_max : corner <= v_min) { v = corner; found = 1; break; }
                rest -= part;
                v = corner;
            }
            slope += b[i];
        }
        if (!found && slope != 0.0) v += rest / slope;
        last = fmin(fmax(v, v_min), v_max);
        u[t] = last;
        for (int i = 0; i < n; i++) h[i] = fmax(last - r[i], fmin(last + r[i], h[i]));
    }
}
