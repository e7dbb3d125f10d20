"""Answers the longer questions: status, model, configuration, history. One thread, so that a slow
asker keeps nobody waiting who commands."""

import logging
import threading
from queue import Empty, SimpleQueue
from typing import Any

import msgspec
import tomli_w

from dehyst.daemon import clock, wire
from dehyst.daemon.bus import Asked
from dehyst.daemon.config import Config
from dehyst.daemon.files import load_model
from dehyst.daemon.history import runs
from dehyst.daemon.messages import HistoryRequest
from dehyst.daemon.publisher import LONGEST_BATCH, Publisher
from dehyst.daemon.records import MODEL_IN_USE
from dehyst.models.errors import DehystError
from dehyst.models.modelfile import dumps

log = logging.getLogger(__name__)
WAITING = 256
COPIED = 65_536
TOML = "application/toml"


def config_text(config: Config) -> str:
    """The configuration in force, defaults included, as TOML."""
    return tomli_w.dumps(_without_none(msgspec.to_builtins(config)))


def _without_none(value: Any) -> Any:
    """TOML has no null: a key that is not set is left out."""
    if isinstance(value, dict):
        return {k: _without_none(v) for k, v in value.items() if v is not None}
    return value


class Librarian:
    """`ask` is called from zenoh's threads, `run` is its own thread."""

    def __init__(self, config: Config, unit: str, publisher: Publisher) -> None:
        self._config, self._unit, self._publisher = config, unit, publisher
        self._questions: SimpleQueue[Asked] = SimpleQueue()

    def ask(self, asked: Asked) -> None:
        """Store a question; where too many wait it gets no answer."""
        if self._questions.qsize() < WAITING:
            self._questions.put(asked)
        else:
            asked.done()

    def run(self, stop: threading.Event) -> None:
        """Until `stop`."""
        while not stop.is_set():
            try:
                asked = self._questions.get(timeout=0.1)
            except Empty:
                continue
            try:
                self._answer(asked)
            except DehystError as error:
                asked.refuse(str(error))
            except Exception:
                log.exception("a question could not be answered: %s", asked.key)
                asked.refuse("an error in the daemon; its log has the details")
            finally:
                asked.done()
                del asked  # an asker waits for as long as the question is held

    def _answer(self, asked: Asked) -> None:
        now_ns = clock.monotonic_ns()
        method = asked.key.rsplit("/", 1)[-1]
        if method == "status":
            asked.reply(wire.encode(self._publisher.status(now_ns)))
        elif method == "model":
            asked.reply(self._model_text().encode(), TOML)
        elif method == "configuration":
            asked.reply(config_text(self._config).encode(), TOML)
        elif method == "history":
            self._history(asked, clock.wall_ns() - now_ns)
        else:
            asked.refuse(f"no such method: {method}")

    def _model_text(self) -> str:
        """The model that the loop runs: its own copy, else the configured file."""
        try:
            return (self._config.directory / MODEL_IN_USE).read_text("utf-8")
        except (OSError, UnicodeDecodeError):
            return dumps(load_model(self._config.model.file))

    def _history(self, asked: Asked, wall_offset_ns: int) -> None:
        try:
            question = wire.decode(HistoryRequest, asked.payload)
        except wire.BadMessage as error:
            asked.refuse(str(error))
            return
        history = self._publisher.history
        first, end = question.first_seq, question.end_seq
        if question.run not in (0, history.run):
            end = first  # that run is over and its samples are gone
        if question.seconds:
            first = max(first, history.end - round(question.seconds / self._config.period_ns * 1e9))
        first, end = max(first, history.first), min(end, history.end)
        for start in range(first, max(end, first + 1), COPIED):
            samples = history.get(start, min(end, start + COPIED))
            for piece in runs(samples, LONGEST_BATCH) or [samples]:
                batch = wire.batch(piece, history.run, self._unit, wall_offset_ns)
                asked.reply(wire.encode(batch))
