/* Stands in for NI's C library in tests: one output, one input, faults on demand.
 *
 * The output drives an amplifier of gain 15 and a stage with hysteresis (play operators). The input
 * is a bridge that follows the output's voltage, or the 0 to 10 V monitor of the stage's
 * displacement. Either may run by the device's clock: the output then changes at edges, and the
 * newest samples are read. Time is the caller's (clock) or CLOCK_MONOTONIC.
 */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <time.h>

#define PLAYS 8
#define CHANGES 256
#define AMPLIFIER_GAIN 15.0
#define MONITOR_V_PER_UM 0.5
#define MONITOR_ZERO_V 0.25
#define MONITOR_NOISE_V 1e-3

struct device {
    int64_t task;      /* the handle that is right */
    int64_t calls;     /* since the start */
    int32_t fail_in;   /* so many calls from now one fails, and all after it; below 0: none */
    int32_t status;    /* what a failing call returns */
    int32_t warning;   /* what a call that succeeds returns */
    double output_v;
    double timeout_s;  /* of the last call */
    double broken_ratio; /* what the input shows when it is not 0 */
    const int64_t *clock; /* where the time [ns] stands; 0: CLOCK_MONOTONIC */
    double output_hz;  /* clock of the output; 0: it changes at once */
    double sample_hz;  /* clock of the input; 0: it is sampled when it is read */
    int32_t offset;    /* of a read, from the newest sample; 0: where the last read ended */
    int32_t monitor;   /* 1: the input is the stage's monitor; 0: a bridge */
    double r[PLAYS], b[PLAYS], w[PLAYS]; /* the stage's play operators */
    int64_t edge_ns;   /* when the pending voltage appears */
    int32_t pending;   /* whether one is pending */
    double pending_v;
    int64_t changes;   /* of the output, so far */
    int64_t change_ns[CHANGES];
    double um[CHANGES], monitor_um; /* after each of the last changes; now */
} device = {.fail_in = -1, .status = -200324};

static int64_t now_ns(void) {
    struct timespec t;
    if (device.clock) return *device.clock;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

static void appear(double volts, int64_t at_ns) {
    double u = AMPLIFIER_GAIN * volts, um = 0.0;
    for (int i = 0; i < PLAYS; i++) {
        double low = u - device.r[i], high = u + device.r[i];
        device.w[i] = device.w[i] < low ? low : device.w[i] > high ? high : device.w[i];
        um += device.b[i] * device.w[i];
    }
    device.output_v = volts;
    device.monitor_um = um;
    device.change_ns[device.changes % CHANGES] = at_ns;
    device.um[device.changes % CHANGES] = um;
    device.changes++;
}

static void settle(int64_t now) {
    if (device.pending && device.edge_ns <= now) {
        device.pending = 0;
        appear(device.pending_v, device.edge_ns);
    }
}

static double sample(int64_t at_ns, int64_t number) {
    double um = device.changes ? device.monitor_um : 0.0;
    if (device.broken_ratio != 0.0) return device.broken_ratio;
    if (!device.monitor) return 2e-4 + 1e-4 * device.output_v + 1e-7 * (double)(device.calls % 7);
    for (int64_t i = device.changes - 1; i >= 0 && i > device.changes - CHANGES; i--) {
        um = device.um[i % CHANGES];
        if (device.change_ns[i % CHANGES] <= at_ns) break;
        um = i ? um : 0.0;
    }
    return MONITOR_ZERO_V + MONITOR_V_PER_UM * um + MONITOR_NOISE_V * (double)(number % 7 - 3);
}

static int32_t call(void *task, double timeout_s) {
    device.calls++;
    device.timeout_s = timeout_s;
    if ((int64_t)task != device.task) return -200088;
    if (device.fail_in == 0) return device.status;
    if (device.fail_in > 0) device.fail_in--;
    return 0;
}

int32_t DAQmxWriteAnalogScalarF64(void *task, uint32_t auto_start, double timeout_s, double value,
                                  uint32_t *reserved) {
    int32_t status = call(task, timeout_s);
    int64_t now = now_ns();
    if (auto_start != 1 || reserved != 0) return -1;
    if (status) return status;
    settle(now);
    if (device.output_hz == 0.0) {
        appear(value, now);
        return device.warning;
    }
    double period_ns = 1e9 / device.output_hz;
    device.edge_ns = (int64_t)((floor((double)now / period_ns) + 1.0) * period_ns);
    device.pending = 1;
    device.pending_v = value;
    return device.warning;
}

int32_t DAQmxReadAnalogScalarF64(void *task, double timeout_s, double *value, uint32_t *reserved) {
    int32_t status = call(task, timeout_s);
    int64_t now = now_ns();
    if (reserved != 0) return -1;
    if (status) return status;
    settle(now);
    *value = sample(now, device.calls);
    return device.warning;
}

int32_t DAQmxReadAnalogF64(void *task, int32_t count, double timeout_s, uint32_t by_scan,
                           double *values, uint32_t room, int32_t *found, uint32_t *reserved) {
    int32_t status = call(task, timeout_s);
    int64_t now = now_ns();
    if (reserved != 0 || by_scan != 0 || count < 1 || (uint32_t)count > room) return -1;
    if (status) return status;
    if (device.offset != 0 && device.offset != -count) return -200279;
    settle(now);
    for (int32_t i = 0; i < count; i++) {
        double period_ns = device.sample_hz > 0.0 ? 1e9 / device.sample_hz : 0.0;
        int64_t newest = period_ns > 0.0 ? (int64_t)floor((double)now / period_ns) : 0;
        int64_t number = newest - count + 1 + i;
        values[i] = period_ns > 0.0 ? sample((int64_t)((double)number * period_ns), number)
                                    : sample(now, device.calls + i);
    }
    *found = count;
    return device.warning;
}

int32_t DAQmxGetErrorString(int32_t code, char *text, uint32_t size) {
    snprintf(text, size, "words of the library for\n%d", code);
    return 0;
}
