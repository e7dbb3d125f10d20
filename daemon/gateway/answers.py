"""Answers queries: status, model, configuration, events, history. They run in their own threads,
one of them for history only, so that a slow query delays neither commands nor shorter queries."""

import logging
import threading
from queue import Empty, SimpleQueue
from typing import Any

import msgspec
import tomli_w

from dehyst.daemon import clock
from dehyst.daemon.bus import encoding
from dehyst.daemon.bus.messages import HistoryRequest, RecentEvents
from dehyst.daemon.bus.session import Asked
from dehyst.daemon.config import Config
from dehyst.daemon.files.models import load_model
from dehyst.daemon.gateway.axis import ServedAxis
from dehyst.daemon.gateway.history import runs
from dehyst.daemon.gateway.publisher import LONGEST_BATCH, Publisher
from dehyst.models.errors import DehystError, NotNow
from dehyst.models.modelfile import dumps

log = logging.getLogger(__name__)
WAITING = 256  # queries; one more gets no answer
COPIED = 65_536  # samples of the history that are copied at a time, which bounds the memory
TOML, HTML = "application/toml", "text/html"


def config_text(config: Config) -> str:
    """Return the configuration in force as TOML, including defaults."""
    return tomli_w.dumps(_without_none(msgspec.to_builtins(config)))


def _without_none(value: Any) -> Any:
    """Leave out keys that are not set, as TOML has no null."""
    if isinstance(value, dict):
        return {k: _without_none(v) for k, v in value.items() if v is not None}
    return value


class Answers:
    """Queue of queries: `ask` is called from zenoh's threads, `run` is the answering thread."""

    def __init__(self) -> None:
        self._questions: SimpleQueue[tuple[ServedAxis, Asked]] = SimpleQueue()

    def ask(self, axis: ServedAxis, asked: Asked) -> None:
        """Queue a query about an axis; if too many are waiting, it gets no answer."""
        if asked.may_wait(self._questions.qsize(), WAITING):
            self._questions.put((axis, asked))
        else:
            asked.done()

    def run(self, stop: threading.Event) -> None:
        """Answer queries until `stop` is set."""
        while not stop.is_set():
            try:
                axis, asked = self._questions.get(timeout=0.1)
            except Empty:
                continue
            try:
                _answer(axis, asked)
            except DehystError as error:
                asked.refuse(str(error))
            except Exception:
                log.exception("a query could not be answered: %s", asked.key)
                asked.refuse("an error in the daemon; its log has the details")
            finally:
                asked.done()
                del asked  # the client waits as long as a reference to the query exists


def _answer(axis: ServedAxis, asked: Asked) -> None:
    now_ns = clock.monotonic_ns()
    method = asked.key.rsplit("/", 1)[-1]
    if method == "status":
        asked.reply(encoding.encode(axis.publisher.status(now_ns)))
    elif method == "model":
        asked.reply(_model_text(axis.publisher).encode(), TOML)
    elif method == "configuration":
        asked.reply(config_text(axis.config).encode(), TOML)
    elif method == "events":
        recent = RecentEvents(events=tuple(axis.publisher.recent_events))
        asked.reply(encoding.encode(recent))
    elif method == "doctor":
        asked.reply(encoding.encode(axis.publisher.doctor_desk.reports()))
    elif method == "report":
        case = asked.payload[:64].decode("utf-8", "replace")
        asked.reply(axis.publisher.doctor_desk.page(case), HTML)
    elif method == "history":
        _give_history(axis, asked, clock.wall_ns() - now_ns)
    else:
        asked.refuse(f"no such method: {method}")


def _model_text(publisher: Publisher) -> str:
    """Return the model that the loop runs, from the loop's own copy."""
    path = publisher.model_path
    if path is None:
        raise NotNow("the loop does not run yet, so its model is not known")
    return dumps(load_model(path))


def _give_history(axis: ServedAxis, asked: Asked, wall_offset_ns: int) -> None:
    try:
        question = encoding.decode(HistoryRequest, asked.payload)
    except encoding.BadMessage as error:
        asked.refuse(str(error))
        return
    history = axis.publisher.history
    first, end = question.first_seq, question.end_seq
    if question.run not in (0, history.run):
        end = first  # that run has ended and its samples are gone
    if question.seconds:
        first = max(first, history.end - round(question.seconds / axis.config.period_ns * 1e9))
    first, end = max(first, history.first), min(end, history.end)
    for start in range(first, max(end, first + 1), COPIED):
        samples = history.get(start, min(end, start + COPIED))
        for piece in runs(samples, LONGEST_BATCH) or [samples]:
            batch = encoding.batch(piece, history.run, axis.publisher.unit, wall_offset_ns)
            asked.reply(encoding.encode(batch))
