"""What is offered, and what becomes of an accepted model."""

from tests.mutations.change import Change, room

REPLAY, TRIAL, GAUGE = (f"models/mismatch/{name}.py" for name in ("replay", "trial", "gauge"))
PURE = ("tests/models/mismatch/test_trial.py",)
DESK, WORK = "daemon/gateway/doctor_desk.py", "daemon/gateway/model_trial.py"
CHOSEN, EXAMINATION = "daemon/files/chosen.py", "daemon/doctor/examination.py"

CHANGES = [
    *room(
        PURE,
        Change(
            "offer-within-noise", REPLAY,
            "return self.in_use**2 - self.offered**2 > self.noise**2",
            "return self.in_use > self.offered",
            "a model is offered that is better by chance",
        ),
        Change(
            "trial-any-error", TRIAL, "if not after.model <= enough:", "if False:",
            "a model whose error has not fallen stays at work",
        ),
        Change(
            "trial-nan-stays", TRIAL, "if not after.model <= enough:",
            "if after.model > enough:",
            "a model of which nothing is known stays at work",
        ),
        Change(
            "trial-any-tracking", TRIAL,
            "if math.isfinite(before.tracking) and not after.tracking <= most:", "if False:",
            "a model that makes the stage follow worse stays at work",
        ),
        Change(
            "gauge-stuck-unseen", GAUGE, "if share > GAUGE.same:", "if False:",
            "a model is offered for a gauge that is stuck",
        ),
        Change(
            "gauge-far-unseen", GAUGE, "if share > GAUGE.beyond_rows:", "if False:",
            "a model is offered for a gauge that reads nonsense",
        ),
    ),
    *room(
        ("tests/daemon/files/test_chosen.py",),
        Change(
            "accepted-over-owner", CHOSEN,
            "if accepted.instead_of != model_digest(dumps(configured)):", "if False:",
            "a model that the owner has configured is passed over",
        ),
    ),
    *room(
        ("tests/daemon/gateway/test_doctor_desk.py",),
        Change(
            "no-way-back", WORK, "        if why:\n            return trial.case",
            "        if False:\n            return trial.case",
            "a wrong model that was accepted stays at work",
        ),
        Change(
            "back-without-reload", WORK,
            "                forget_accepted(self._config.directory)\n            self._reload()",
            "                forget_accepted(self._config.directory)",
            "the loop goes on with the wrong model",
        ),
        Change(
            "accept-twice", DESK, "        if state not in OPEN:\n            return",
            "        if False:\n            return", "an offer that was rejected goes to work",
        ),
    ),
    *room(
        ("tests/daemon/doctor/test_examination.py",),
        Change(
            "gauge-diagnosed", EXAMINATION, "    if fault:\n", "    if False:\n",
            "a gauge that fails becomes a model",
        ),
    ),
    *room(
        ("tests/daemon/bus/test_security.py",),
        Change(
            "observers-command", "daemon/bus/security.py",
            'QUESTIONS = ("status", ', 'QUESTIONS = ("command", "status", ',
            "an observer commands the stage and accepts models",
        ),
    ),
]  # fmt: skip
