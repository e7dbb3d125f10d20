"""All models of the benchmark, in the order of the table."""

from dehyst.daemon.benchmark.rivals.narx import NARX
from dehyst.daemon.benchmark.rivals.neural_net import NEURAL_NET
from dehyst.daemon.benchmark.rivals.play_models import CLASSICAL, THIS
from dehyst.daemon.benchmark.rivals.preisach import PREISACH
from dehyst.daemon.benchmark.rivals.rate_equations import BOUC_WEN, DUHEM

RIVALS = (THIS, CLASSICAL, PREISACH, BOUC_WEN, DUHEM, NARX, NEURAL_NET)
