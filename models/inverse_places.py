"""Where the numbers of the preview lie in its arrays."""

# Places in `fixed`.
(
    U_OFFSET, Y_FIRST, Y_LAST, LOW, HIGH, RATE, PERIOD, PER_NODE, NOISE, SLOPE, SWEEPS, PRICE,
    N_FIXED,
) = range(13)  # fmt: skip
# Places in `state`.
(
    LAST, X_0, X_BEFORE, PHASE, DAMPING, SHADOW, SUM_REAL, SUM_SHADOW, SUM_TIME, STATIC_LEFT,
    PROMISED, SLOPE_0, SLOPE_1, VALID, NODES, TARGET_NOW, LOWEST, HIGHEST, LOST, GAP, WORST,
    MOVED, BEEN_LOW, BEEN_HIGH, DUE, MEAN, HOW, LAG, PATIENCE, PEAK, N_STATE,
) = range(31)  # fmt: skip
# Rows of `work` (N_WORK, P), P >= 4.
PLAN, TRIAL, TARGET, TRUST, SMOOTHNESS, ROWS, BANDS, BOUNDS, N_WORK = 0, 1, 2, 3, 4, 5, 9, 13, 14
# Rows of `plays` (N_PLAYS, n).
REAL, SHADOW_PLAYS, SCRATCH, AHEAD, LATER, SHADOW_LATER, N_PLAYS = range(7)
