/* Stands in for NI's C library in tests: one output, one bridge that follows it, faults on demand. */
#include <stdint.h>
#include <stdio.h>

struct device {
    int64_t task;      /* the handle that is right */
    int64_t calls;     /* since the start */
    int32_t fail_in;   /* so many calls from now one fails, and all after it; below 0: none */
    int32_t status;    /* what a failing call returns */
    int32_t warning;   /* what a call that succeeds returns */
    double output_v;
    double timeout_s;  /* of the last call */
    double broken_ratio; /* what the bridge shows when it is not 0 */
} device = {0, 0, -1, -200324, 0, 0.0, 0.0, 0.0};

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
    if (auto_start != 1 || reserved != 0) return -1;
    if (status) return status;
    device.output_v = value;
    return device.warning;
}

int32_t DAQmxReadAnalogScalarF64(void *task, double timeout_s, double *value, uint32_t *reserved) {
    int32_t status = call(task, timeout_s);
    if (reserved != 0) return -1;
    if (status) return status;
    *value = 2e-4 + 1e-4 * device.output_v + 1e-7 * (double)(device.calls % 7);
    if (device.broken_ratio != 0.0) *value = device.broken_ratio;
    return device.warning;
}

int32_t DAQmxGetErrorString(int32_t code, char *text, uint32_t size) {
    snprintf(text, size, "words of the library for\n%d", code);
    return 0;
}
