/* Stands in for LabJack's LJM library in tests: one unit with its registers, faults on demand.
 *
 * AIN0 shows 0.5 V and 0.8 times what DAC0 gives, with noise of period 5; TDAC0 drives it alike.
 */
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#define REGISTERS 32
#define NAME 32

struct unit {
    int32_t handle;   /* the one that is right; a new one each time that the unit is opened */
    int32_t is_open;
    int32_t plugged;
    int32_t kind;     /* 7: a T7 */
    int32_t serial;
    int32_t fail_in;  /* so many calls from now one fails, and all after it; below 0: none */
    int32_t status;   /* what a failing call returns */
    int32_t opened;   /* how often */
    int64_t calls;
    double broken_v;  /* what AIN0 shows when it is not 0 */
    double timeout_ms;
    int32_t count;    /* of registers that were written */
    char names[REGISTERS][NAME];
    double values[REGISTERS];
} unit = {.plugged = 1, .kind = 7, .serial = 470012345, .fail_in = -1};

static int32_t call(int32_t handle) {
    unit.calls++;
    if (!unit.is_open || handle != unit.handle) return 1224; /* device not open */
    if (!unit.plugged) return 1239;                          /* reconnecting failed */
    if (unit.fail_in == 0) return unit.status;
    if (unit.fail_in > 0) unit.fail_in--;
    return 0;
}

static double *at(const char *name) {
    for (int i = 0; i < unit.count; i++)
        if (!strcmp(unit.names[i], name)) return &unit.values[i];
    if (unit.count == REGISTERS || strlen(name) >= NAME) return 0;
    strcpy(unit.names[unit.count], name);
    unit.values[unit.count] = 0.0;
    return &unit.values[unit.count++];
}

int32_t LJM_OpenS(const char *kind, const char *connection, const char *identifier, int32_t *handle) {
    if (strcmp(kind, "T7") && strcmp(kind, "ANY")) return 1227; /* not found */
    if (!unit.plugged || !strcmp(identifier, "absent")) return 1227;
    if (unit.is_open) return 1229; /* already open: a driver must share its handle */
    unit.is_open = 1;
    unit.opened++;
    *handle = ++unit.handle;
    return 0;
}

int32_t LJM_Close(int32_t handle) {
    if (!unit.is_open || handle != unit.handle) return 1224;
    unit.is_open = 0;
    return 0;
}

int32_t LJM_GetHandleInfo(int32_t handle, int32_t *kind, int32_t *connection, int32_t *serial,
                          int32_t *address, int32_t *port, int32_t *most_bytes) {
    *kind = unit.kind; *connection = 1; *serial = unit.serial;
    *address = 0; *port = 0; *most_bytes = 64;
    return handle == unit.handle ? 0 : 1224;
}

int32_t LJM_WriteLibraryConfigS(const char *name, double value) {
    if (strcmp(name, "LJM_SEND_RECEIVE_TIMEOUT_MS")) return 1280;
    unit.timeout_ms = value;
    return 0;
}

int32_t LJM_eWriteName(int32_t handle, const char *name, double value) {
    int32_t status = call(handle);
    if (status) return status;
    double *place = at(name);
    if (!place) return 1294; /* invalid name */
    *place = value;
    return 0;
}

int32_t LJM_eReadName(int32_t handle, const char *name, double *value) {
    int32_t status = call(handle);
    if (status) return status;
    if (!strcmp(name, "SERIAL_NUMBER")) *value = unit.serial;
    else if (!strcmp(name, "AIN0"))
        *value = unit.broken_v != 0.0 ? unit.broken_v
                 : 0.5 + 0.8 * (*at("DAC0") + *at("TDAC0")) + 1e-4 * (double)(unit.calls % 5 - 2);
    else if (!strncmp(name, "DAC", 3)) *value = *at(name);
    else return 1294;
    return 0;
}

int32_t LJM_eReadNames(int32_t handle, int32_t count, const char **names, double *values,
                       int32_t *error_at) {
    *error_at = -1;
    if (count > 14) return 1303; /* more than a packet holds */
    for (int i = 0; i < count; i++) {
        int32_t status = LJM_eReadName(handle, names[i], &values[i]);
        if (status) return status;
    }
    return 0;
}

void LJM_ErrorToString(int32_t code, char *text) {
    snprintf(text, 256, "words of the library for %d", code);
}
