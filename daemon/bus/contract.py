"""Generates the bus contract for other languages: a JSON Schema per message, from the classes.

    python -m dehyst.daemon.bus.contract docs/schemas

writes one file per message. Descriptions are the sentences below each field in messages.py; bytes
fields state which numbers they hold. `tests/daemon/bus/test_contract.py` fails if the files are out
of date.
"""

import ast
import inspect
import json
import sys
from enum import IntEnum, IntFlag
from functools import cache
from pathlib import Path
from typing import Any

import msgspec

from dehyst.daemon.bus import messages
from dehyst.daemon.rings import status
from dehyst.daemon.rings.records import TELEMETRY, Flag, MissCause, Mode, State, name_of

MESSAGES: tuple[type[msgspec.Struct], ...] = (
    messages.Setpoint,
    messages.Chunk,
    messages.Request,
    messages.HistoryRequest,
    messages.Reply,
    messages.Rejection,
    messages.Event,
    messages.RecentEvents,
    messages.DoctorReport,
    messages.DoctorReports,
    messages.TelemetryBatch,
    messages.Status,
)
"""Every message that is sent on its own."""
NUMBERS = {
    **{n: TELEMETRY[n].newbyteorder("<").str for n in TELEMETRY.names or ()},
    "offset_ns": "<i8",
    "value": "<f8",
    "correction": "<f8",
}
"""Number type of each bytes field, in numpy's notation (little-endian)."""


def _listed(kind: type[IntEnum] | type[IntFlag]) -> str:
    """List the numbers of an enumeration and their names."""
    return ", ".join(f"{one.value} {name_of(kind, one.value)}" for one in kind)


COMMON = {
    "client": "Random number that the client chooses, not 0, the same in all of its messages.",
    "lease": "The number that the daemon issued with the lease.",
    "Request.lease": "The number that the daemon issued with the lease; ignored where the action "
    "needs no lease.",
    "unit": "Of displacements: that of the model in use; a command in another unit is refused.",
    "sent_ns": "The sender's own monotonic clock, the same in all of its messages; the daemon "
    "compares it with that of the message that arrived with the least delay since the lease began.",
    "trajectory": "Random number that the client chooses for the trajectory, not 0.",
    "allow_unreachable": "True: go to the nearest reachable point and flag it instead of refusing.",
    "time_ns": "The controller's monotonic clock.",
    "wall_ns": "The same moment, ns since 1970.",
    "code": "Short reason, for programs: see the table of codes.",
    "Event.code": "Short name of the event, for programs; the list may grow.",
    "text": "Description for people.",
    "name": "Name of the controller or axis, as in the keys.",
    "pid": "Process number.",
    "noise": "Noise of the recording, rms in the stage's unit.",
    "rms_in_use": "Residual of the model in use on the recording, rms.",
    "rms_offered": "Residual of the offered model on it, rms.",
    "Setpoint.value": "Target, relative to the set-point origin, in `unit`.",
    "Chunk.last": "True: no chunk after this one.",
    "Request.action": "The requested action: see the table of actions.",
    "Request.trajectory": "clear: the one to discard.",
    "Request.value": "zero: added to every reading from now on.",
    "HistoryRequest.first_seq": "Sequence number of the first requested sample.",
    "HistoryRequest.end_seq": "One above the last requested sample, which is not included itself.",
    "HistoryRequest.seconds": "Above 0: the last seconds, instead of a range of numbers.",
    "Reply.ok": "False: refused, nothing happened.",
    "Rejection.client": "Whose commands were refused.",
    "Rejection.count": "How many since the last such message.",
    "Event.level": "1 information, 2 warning, 3 error.",
    "RecentEvents.events": "Oldest first.",
    "DoctorReport.case": "Name of the mismatch: the folder of its recordings.",
    "DoctorReport.time_ns": "Of the mismatch, the controller's monotonic clock.",
    "DoctorReport.state": "See the description of the message.",
    "DoctorReport.says": "The findings in words.",
    "DoctorReport.effects": "The effects found, strongest first.",
    "DoctorReport.rms_augmented": "Residual of the augmented model on the recording, rms.",
    "DoctorReport.has_report": "True: `rpc/report` answers with a page.",
    "DoctorReport.offer": "The offered model; nil: none.",
    "DoctorReports.reports": "The newest last.",
    "FoundEffect.name": "The vocabulary of diagnosis.json.",
    "FoundEffect.acts_on": "stage, drive or sensor.",
    "FoundEffect.ambiguous_with": "Effects that the recording does not distinguish from it.",
    "FoundEffect.says": "One sentence.",
    "TelemetryBatch.first_seq": "Sequence number of the first sample; the others follow it.",
    "TelemetryBatch.count": "Number of samples.",
    "TelemetryBatch.scheduled_ns": "When the sample was due, the controller's monotonic clock.",
    "TelemetryBatch.actual_ns": "When the sample began.",
    "TelemetryBatch.target": "The set-point that was followed; NaN: none.",
    "TelemetryBatch.measured": "The gauge's reading; NaN: no valid reading.",
    "TelemetryBatch.predicted": "The model's position, including trim and learning.",
    "TelemetryBatch.trim": "The slow trim's correction of the target.",
    "TelemetryBatch.learned": "The learned correction of the target at this point.",
    "TelemetryBatch.volts_raw": "The inverse's voltage before range and slew [V].",
    "TelemetryBatch.volts": "The voltage that was written [V].",
    "TelemetryBatch.flags": f"Bits: {_listed(Flag)}.",
    "TelemetryBatch.state": f"{_listed(State)}.",
    "TelemetryBatch.mode": f"The inverse that computed the voltage: {_listed(Mode)}.",
    "TelemetryBatch.cause": f"Why a deadline was missed: {_listed(MissCause)}.",
    "TelemetryBatch.io_us": "Time in calls of the drivers [us].",
    "TelemetryBatch.exec_us": "From the wake-up to the end of the write [us].",
    "Status.run": "Number of the loop's run. Another number: the loop was restarted, and the "
    "sequence numbers begin at 0 again.",
    "Status.trajectory_start_ns": "Time 0 of the trajectory that is being played, during the "
    "approach in the future; 0: none.",
    "Status.software": "Version of dehyst that the daemon runs.",
    "Status.drive_unit": "Unit of the model's drive.",
    "Status.time_ns": "When this was written, the controller's monotonic clock.",
    "Status.state": "A name of the table of states, in small letters.",
    "Status.priority": "Real-time priority of the loop; 0: none.",
    "Status.samples": "Samples of this run.",
    "Status.missed_by": "Missed deadlines by cause.",
    "Status.actuator_ok": "False: the amplifier does not answer.",
    "Status.sensor_ok": "False: the gauge does not answer.",
    "Status.actuator_errors": "Failed calls of this run.",
    "Status.sensor_errors": "Failed calls of this run.",
    "Status.volts": "The voltage at the output [V].",
    "Status.trajectory_done": "True: `trajectory` was played to its last point.",
    "Status.reach_max": "Largest reachable set-point.",
    "Status.reach_min": "Smallest reachable set-point.",
    "Status.period_ns": "Sampling period; 0: the loop is starting.",
    "Status.gateway": "The status of the gateway's process.",
    "GatewayStatus.uptime_s": "Since the gateway's start.",
    "GatewayStatus.samples_published": "Since the gateway's start.",
    "GatewayStatus.commands": "Commands that were admitted.",
    "GatewayStatus.lease_client": "Number of the client that holds the lease; 0: nobody.",
    "GatewayStatus.lease_label": "The label that it gave itself.",
    "GatewayStatus.lease_left_s": "Until the lease ends, unless it is renewed.",
    "GatewayStatus.restarts_of_core": "Number of restarts of the loop.",
}
"""Descriptions of fields without a sentence below them: by field, or by class and field."""
WORDS = {
    "<i8": "int64", "<u8": "uint64", "<u4": "uint32", "<u2": "uint16", "<i4": "int32",
    "<f8": "float64", "<f4": "float32", "|u1": "uint8", "<u1": "uint8",
}  # fmt: skip


@cache
def meanings() -> dict[str, dict[str, str]]:
    """Return the sentence below each field by class and field; by class and "" the class's own
    docstring."""
    found: dict[str, dict[str, str]] = {}
    for module in (messages, status):
        for node in ast.parse(inspect.getsource(module)).body:
            if isinstance(node, ast.ClassDef):
                said = found.setdefault(node.name, {"": ast.get_docstring(node) or ""})
                for field, below in zip(node.body, node.body[1:], strict=False):
                    if not (isinstance(field, ast.AnnAssign) and isinstance(below, ast.Expr)):
                        continue
                    text = getattr(below.value, "value", "")
                    if isinstance(field.target, ast.Name) and isinstance(text, str):
                        said[field.target.id] = " ".join(text.split())
    return found


def name_of_message(kind: type[msgspec.Struct]) -> str:
    """Return the `schema` that names the message on the wire."""
    return str(kind.__struct_config__.tag)


def meaning_of(kind: type[msgspec.Struct], field: str) -> str:
    """Return the description of a field, from this class or the class that it is inherited from."""
    if text := COMMON.get(f"{kind.__name__}.{field}"):
        return text
    for one in kind.__mro__:
        if text := meanings().get(one.__name__, {}).get(field):
            return text
    return COMMON.get(field, "")


def schema_of(kind: type[msgspec.Struct]) -> dict[str, Any]:
    """Return the self-contained JSON Schema of one message. Bytes fields are msgpack `bin`."""
    (root,), parts = msgspec.json.schema_components((kind,), ref_template="#/$defs/{name}")
    own = parts.pop(root["$ref"].rsplit("/", 1)[-1])
    _explain(own, kind)
    for name, part in parts.items():
        inner = getattr(messages, name, None) or getattr(status, name)
        _explain(part, inner)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": f"{name_of_message(kind)}.json",
        **own,
        **({"$defs": parts} if parts else {}),
    }


def _explain(schema: dict[str, Any], kind: type[msgspec.Struct]) -> None:
    """Add descriptions and the contents of bytes fields; unknown fields are allowed."""
    schema["description"] = " ".join((inspect.getdoc(kind) or "").split())
    if "schema" in schema["properties"]:  # every message carries both, even if they have defaults
        schema["required"] = sorted({*schema.get("required", ()), "schema", "version"})
    for name, field in schema["properties"].items():
        if field.get("contentEncoding") == "base64":
            number = WORDS[NUMBERS[name]]
            field.clear()
            field["$comment"] = (
                f"msgpack bin: {number}, little-endian, one for each sample or point"
            )
        elif field.get("default") != field.get("default"):
            del field["default"]  # NaN, which JSON cannot represent
        if text := meaning_of(kind, name):
            field["description"] = text


def schemas() -> dict[str, dict[str, Any]]:
    """Return every schema by the name of its message."""
    plain = {name_of_message(kind): schema_of(kind) for kind in MESSAGES}
    found: dict[str, dict[str, Any]] = json.loads(json.dumps(plain))  # tuples become lists
    return found


def write_schemas(folder: Path) -> list[Path]:
    """Write the schemas and return their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, schema in schemas().items():
        path = folder / f"{name}.json"
        path.write_text(json.dumps(schema, indent=1) + "\n", encoding="utf-8")
        written.append(path)
    return written


if __name__ == "__main__":
    print("\n".join(map(str, write_schemas(Path(sys.argv[1])))))
