"""Runs players to their ends: of one axis, or of several that play together.

Several axes of a controller that play together each receive their own chunks, and the loop follows
them on the same samples. They start together or not at all, and if one ends early the others are
stopped.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from dehyst.daemon import clock
from dehyst.daemon.client.player import LEAD_S, Connection, Played, Player
from dehyst.daemon.client.repeated import Repeated
from dehyst.daemon.interrupts import noted_interrupts
from dehyst.models.errors import DehystError

if TYPE_CHECKING:  # importing scipy is slow
    from dehyst.daemon.client.learning import LessonTaker


def play(
    client: Connection,
    points: Repeated,
    allow_unreachable: bool = False,
    progress: Callable[[float, float], None] | None = None,
    on_samples: Callable[[NDArray[Any]], None] | None = None,
    lead_s: float = LEAD_S,
    lessons: "LessonTaker | None" = None,
) -> Played:
    """See Client.play. lessons: learns from each pass and corrects the points of the next one."""
    player = Player(client, points, allow_unreachable, lead_s, lessons)
    return play_together([player], progress, on_samples)[0]


def play_together(
    players: Sequence[Player],
    progress: Callable[[float, float], None] | None = None,
    on_samples: Callable[[NDArray[Any]], None] | None = None,
) -> list[Played]:
    """Play to the end and return the result of each axis. progress is that of the first axis;
    on_samples is for a single axis only. See Client.play, Group.play."""
    with noted_interrupts() as raise_noted:
        return _play_together(players, progress, on_samples, raise_noted)


def _play_together(
    players: Sequence[Player],
    progress: Callable[[float, float], None] | None,
    on_samples: Callable[[NDArray[Any]], None] | None,
    raise_noted: Callable[[], None],
) -> list[Played]:
    shown_ns, first = 0, players[0]
    patience_s = [player.client.patience_s for player in players]
    try:
        for player in players:
            player.client.patience_s = 0.0  # never block: telemetry is read in the same loop
        while True:
            raise_noted()
            now_ns = clock.monotonic_ns()
            _send_due(players, now_ns)
            for player in players:
                samples = player.hear(0.02 if player is first else 0.0)
                if on_samples is not None and samples.size:
                    on_samples(samples)
            ended = [player.ended(now_ns) for player in players]
            over = any(ended) or None not in ended
            if progress is not None and (over or now_ns - shown_ns > 2e8):
                shown_ns = now_ns
                progress(first.tracking.samples * first.period_s, first.points.duration_s)
            if over:
                _stop_others(players, ended)
                return [p.result(e) for p, e in zip(players, _reasons(ended), strict=True)]
    except KeyboardInterrupt:
        _stop_all(players, patience_s)
        if first.points.total is None:  # an interrupt is the regular end of an endless trajectory
            for player in players:
                player.tracking.expected = player.tracking.samples
            return [player.result("") for player in players]
        raise
    except BaseException:  # of a callback, for instance: what was sent ahead is not played
        _stop_begun(players)
        raise
    finally:
        for player, patience in zip(players, patience_s, strict=True):
            player.client.patience_s = patience
            player.stream.close()
            player.feed.close()


def _send_due(players: Sequence[Player], now_ns: int) -> None:
    """Send the chunks that are due. If one axis's first chunk is refused, no axis has started: the
    gateway forwards the first chunks of all axes together."""
    for player in players:
        if now_ns >= player.due_ns and not player.silent_too_long(now_ns):
            player.send(now_ns)


def _stop_all(players: Sequence[Player], patience_s: Sequence[float]) -> None:
    """Stop every axis, each with its own patience. Raises the first error once all were asked."""
    errors = []
    for player, patience in zip(players, patience_s, strict=True):
        player.client.patience_s = patience
        try:
            player.client.stop()
        except DehystError as error:
            errors.append(error)
    if errors:
        raise errors[0]


def _stop_begun(players: Sequence[Player]) -> None:
    for player in players:
        if player.index:
            with suppress(DehystError):  # otherwise it runs out of points and holds
                player.client.stop()


def _stop_others(players: Sequence[Player], ended: Sequence[str | None]) -> None:
    """Stop the axes that would otherwise continue alone."""
    if any(ended):
        _stop_begun([p for p, e in zip(players, ended, strict=True) if e is None])


def _reasons(ended: Sequence[str | None]) -> list[str]:
    """Return why each axis ended; "": it was played to the end."""
    why = next((reason for reason in ended if reason), "")
    return [f"it was stopped with another axis: {why}" if e is None else e for e in ended]
