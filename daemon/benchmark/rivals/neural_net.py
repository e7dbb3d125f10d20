"""Small neural network whose inputs are play operators, the drive, and its deviations from filtered
drives.

The play operators are its memory (Dang and Tan, Sens. Actuators A 139, 2007, put hysteretic
operators before a network); one hidden layer, trained by scikit-learn from a seed. Needs
scikit-learn.
"""

import warnings

import numpy as np
import scipy.signal

from dehyst.daemon.benchmark.rivals.interface import Predict, Rival, Scale, measured
from dehyst.models.errors import BadRecording
from dehyst.models.hysteresis.play import play_matrix
from dehyst.models.recording import Floats, Recording

PLAYS = 0.5 * np.arange(1, 9) / 9.0  # thresholds, of the range
LAGS_S = (0.01, 0.1)  # of the filtered drives
HIDDEN, STEPS, SEED = 16, 400, 1  # neurons; training ends after STEPS, converged or not
PENALTY = 1e-4  # on the squared weights, scikit-learn's default


def features(t_s: Floats, u: Floats) -> Floats:
    """Return (N, m) inputs of the network. u: as a share of the range."""
    period_s = float(np.mean(np.diff(t_s)))
    columns = [u, *play_matrix(PLAYS, u, np.zeros(PLAYS.size)).T]
    for lag_s in LAGS_S:
        a = np.exp(-period_s / lag_s)
        slow, _ = scipy.signal.lfilter([1.0 - a], [1.0, -a], u, zi=[a * u[0]])
        columns.append(u - slow)
    return np.stack(columns, axis=1)


def fit_neural_net(recording: Recording) -> Predict:
    """Scale all inputs to a standard deviation of 1, and fit the weights by L-BFGS."""
    try:
        from sklearn.exceptions import ConvergenceWarning
        from sklearn.neural_network import MLPRegressor
    except ImportError:
        raise BadRecording("needs scikit-learn (pip install 'dehyst[bench]')") from None
    scale = Scale.of(recording)
    x = features(recording.t_s, scale.drive(recording.drive))
    mean, std = x.mean(axis=0), x.std(axis=0) + 1e-9
    net = MLPRegressor(
        hidden_layer_sizes=(HIDDEN,),
        activation="tanh",
        solver="lbfgs",
        alpha=PENALTY,
        max_iter=STEPS,
        random_state=SEED,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # training stops after STEPS
        net.fit((x - mean) / std, scale.displacement(measured(recording)))

    def predict(t_s: Floats, u: Floats) -> Floats:
        return scale.back(net.predict((features(t_s, scale.drive(u)) - mean) / std))

    return predict


NEURAL_NET = Rival(
    "neural net",
    fit_neural_net,
    "no",
    "one hidden layer of 16 on 8 plays; Dang and Tan, Sens. Actuators A 2007",
)
