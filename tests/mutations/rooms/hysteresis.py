"""The paper's equations, and the nearest monotone model."""

from tests.mutations.change import Change, room

FORWARD, PLAY = "models/hysteresis/forward.py", "models/hysteresis/play.py"
MONOTONE, SATURATION = "models/hysteresis/monotone.py", "models/hysteresis/saturation.py"

CHANGES = [
    *room(
        ("tests/models/hysteresis/test_forward.py",),
        Change(
            "no-offset",
            FORWARD,
            "play_step(r, h, u - u_offset)\n    z = 0.0",
            "play_step(r, h, u)\n    z = 0.0",
            "a bipolar stage is predicted about the wrong centre",
        ),
        Change(
            "rate-sign",
            FORWARD,
            "z += (b[i] + k[i] * rate) * h[i]",
            "z += (b[i] - k[i] * rate) * h[i]",
            "fast motion is compensated in the wrong direction",
        ),
        Change(
            "rate-left-out",
            FORWARD,
            "z += (b[i] + k[i] * rate) * h[i]",
            "z += b[i] * h[i]",
            "fast motion is not compensated",
        ),
        Change(
            "first-rate",
            FORWARD,
            "before = u[0] if u.size else 0.0",
            "before = 0.0",
            "a recording begins with a rate that never occurred",
        ),
        Change(
            "starts-energised",
            FORWARD,
            "h = np.zeros(model.n) if h0 is None else",
            "h = np.ones(model.n) if h0 is None else",
            "the loop starts from a wrong state",
        ),
    ),
    *room(
        ("tests/models/hysteresis/test_nearest_monotone.py",),
        Change(
            "price-halved",
            MONOTONE,
            "price = float(np.sqrt(np.mean(",
            "price = 0.5 * float(np.sqrt(np.mean(",
            "the reported cost is half the true one",
        ),
        Change(
            "price-mean",
            MONOTONE,
            "simulate_hysteresis(near, u, dt) - simulate_hysteresis(h, u, dt)",
            "simulate_hysteresis(near, u, 2 * dt) - simulate_hysteresis(h, u, 2 * dt)",
            "the cost is computed at half the rate",
        ),
        Change(
            "margin-a-tenth",
            MONOTONE,
            "MARGIN = 0.05",
            "MARGIN = 0.005",
            "the inverse of the nearest model is ten times as steep",
        ),
        Change(
            "margin-three-times",
            MONOTONE,
            "MARGIN = 0.05",
            "MARGIN = 0.15",
            "the nearest model is further away than necessary",
        ),
        Change(
            "sign-of-k",
            MONOTONE,
            "0.5 * (up - down) / rate",
            "0.5 * (down - up) / rate",
            "fast motion is compensated in the wrong direction",
        ),
        Change(
            "k-halved",
            MONOTONE,
            "0.5 * (up - down) / rate",
            "0.25 * (up - down) / rate",
            "fast motion is only half compensated",
        ),
        Change(
            "weight-left-out",
            MONOTONE,
            "columns = sign * columns * weight[:, None]",
            "columns = sign * columns",
            "the nearest model is only near before the saturation",
        ),
        Change(
            "not-nearest",
            MONOTONE,
            "    sums = sign * np.maximum(sums, low)\n",
            "    sums = sign * np.maximum(old, low)\n",
            "slopes are raised to the margin without adjusting the others",
        ),
        Change(
            "falls-become-rises",
            MONOTONE,
            "sums = sign * np.maximum(sums, low)",
            "sums = np.maximum(sums, low)",
            "a falling stage becomes a rising one",
        ),
        Change(
            "k-kept-at-rest",
            MONOTONE,
            "model = replace(model, hysteresis=replace(h, k=np.zeros(h.n)))",
            "pass",
            "a static inverse is made from a model with rates",
        ),
    ),
    *room(
        ("tests/models/inverse/test_static.py",),
        Change(
            "branch-ends",
            SATURATION,
            "        return z_knots[last]\n    if c.size",
            "        return z_knots[0]\n    if c.size",
            "beyond the saturation the drive goes to the other end",
        ),
        Change(
            "bisection-side",
            SATURATION,
            "if (error > 0.0) == rising:",
            "if (error > 0.0) != rising:",
            "the saturation is inverted wrongly",
        ),
    ),
]
