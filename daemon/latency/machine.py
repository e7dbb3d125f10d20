"""Report what this machine offers a loop with deadlines, and what its owner can change. Reads
only."""

import os
import resource
from pathlib import Path

from dehyst.daemon.loop.timing.realtime import AWAKE_FROM_HZ, IDLE_LATENCY, Obtained


def _text(path: str) -> str:
    try:
        return Path(path).read_text().strip()
    except OSError:
        return ""


def usable_cpus() -> tuple[int, ...]:
    """Return the numbers of the CPUs that this process can use."""
    return tuple(sorted(os.sched_getaffinity(0)))


def facts(cpu: int) -> dict[str, str]:
    """Return kernel, CPUs, clock and similar facts as text; `cpu`: the loop's CPU, -1: any."""
    flags = _text("/proc/cpuinfo")
    one = max(cpu, 0)
    return {
        "kernel": f"{os.uname().release} {os.uname().machine}",
        "preemption": "PREEMPT_RT" if _text("/sys/kernel/realtime") == "1" else "no PREEMPT_RT",
        "cpus": f"{len(usable_cpus())} of {os.cpu_count()}",
        "isolated": _text("/sys/devices/system/cpu/isolated") or "none",
        "clock source": _text("/sys/devices/system/clocksource/clocksource0/current_clocksource"),
        "governor": _text(f"/sys/devices/system/cpu/cpu{one}/cpufreq/scaling_governor")
        or "not adjustable",
        "virtual machine": "yes" if " hypervisor" in flags else "no sign of one",
        "load": _text("/proc/loadavg").partition(" ")[0],
    }


def advice(
    found: dict[str, str], obtained: Obtained, cpu: int, asked_priority: int, rate_hz: float
) -> list[str]:
    """Return what would make the deadlines safer, most important first."""
    words = []
    if asked_priority and not obtained.fifo:
        soft = resource.getrlimit(resource.RLIMIT_RTPRIO)[0]
        words.append(
            f"privileges: no FIFO scheduling (real-time priority limit {soft}). The systemd unit "
            "sets LimitRTPRIO=80; for a shell: `rtprio 80` in /etc/security/limits.d"
        )
    if not obtained.locked:
        words.append(
            "privileges: memory is not locked, so pages may be swapped out. "
            "LimitMEMLOCK=infinity, or `memlock unlimited` in /etc/security/limits.d"
        )
    if asked_priority and rate_hz >= AWAKE_FROM_HZ and not obtained.awake:
        words.append(
            f"privileges: {IDLE_LATENCY} is not writable, so a CPU may sleep deeply between "
            "samples and wake some 100 us late; the udev rule in systemd/ opens it to the group"
        )
    count = os.cpu_count() or 1
    many = count > 1
    if many and found["isolated"] == "none" and rate_hz > 500:  # slower loops have 2 ms or more
        words.append(
            f"isolated CPU: boot with isolcpus={count - 1} "
            "nohz_full and rcu_nocbs for the same CPU, and set loop.cpu to it"
        )
    elif many and cpu < 0 and found["isolated"] != "none":
        words.append(f"isolated CPU: {found['isolated']} is isolated and unused; set loop.cpu")
    if found["governor"] not in ("performance", "not adjustable"):
        words.append(
            f"governor: {found['governor']} lets the CPU slow down between samples; "
            "`cpupower frequency-set -g performance`"
        )
    if not obtained.fifo:
        words.append(
            "timer slack: set to 1 ns for the loop (Linux gives ordinary threads 50 us); nothing "
            "to do"
        )
    if found["preemption"] != "PREEMPT_RT":
        words.append(
            "kernel: no PREEMPT_RT; drivers and interrupts may hold the CPU for some 100 us. "
            "Debian: linux-image-rt-amd64"
        )
    if found["virtual machine"] == "yes":
        words.append(
            "virtual machine: the hypervisor may stop it for milliseconds, and nothing inside can "
            "prevent that; for a real stage use real hardware"
        )
    return words
