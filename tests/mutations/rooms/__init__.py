"""The changes, by room."""

from tests.mutations.rooms import (
    bus,
    checks,
    diagnosis,
    doctor,
    drivers,
    files,
    gate,
    hysteresis,
    identify,
    inverse,
    learning,
    mismatch,
    motion,
    rings,
    safety,
    setup,
)

ROOMS = {
    "motion": motion.CHANGES,
    "setup": setup.CHANGES,
    "gate": gate.CHANGES,
    "bus": bus.CHANGES,
    "rings": rings.CHANGES,
    "safety": safety.CHANGES,
    "checks": checks.CHANGES,
    "drivers": drivers.CHANGES,
    "files": files.CHANGES,
    "hysteresis": hysteresis.CHANGES,
    "inverse": inverse.CHANGES,
    "identify": identify.CHANGES,
    "diagnosis": diagnosis.CHANGES,
    "doctor": doctor.CHANGES,
    "mismatch": mismatch.CHANGES,
    "learning": learning.CHANGES,
}
