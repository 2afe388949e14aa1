"""The part of the page that plays motions: what may happen, and the virtual sliding."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Any

from graspless_pin.viewer.auth import Gate, is_switch, number_between, one_of
from graspless_pin.viewer.scene_view import Stage
from graspless_pin.visualization import Picture
from graspless_pin.visualization.motion import MovingPicture

_FRAME = 0.08  # s
_STILL_FRAMES = 10  # at the motion's end
OUTCOME, SLIDING = "what can happen", "virtual sliding"
"""The motions that there may be."""


class Player:
    """Controls that show a motion and play it, slowed, again and again, when they are asked to.

    Nothing moves before: a server does not know who wants little motion.
    """

    def __init__(self, server: Any, gate: Gate, stage: Stage) -> None:
        """Lay the controls out where the page is being built."""
        self._server, self._stage = server, stage
        self._motions: Mapping[str, MovingPicture] = {}
        self._picture: Picture | None = None
        self._lock, self._stopped = threading.RLock(), threading.Event()
        gui = server.gui
        self._folder = gui.add_folder("Motion", visible=False)
        with self._folder:
            self._which = gui.add_dropdown("motion", (OUTCOME, SLIDING))
            self._shown = gui.add_checkbox("show", initial_value=False)
            self._play = gui.add_checkbox("play", initial_value=False)
            self._time = gui.add_slider("time", 0.0, 1.0, 0.01, 1.0)
        for control, check in (
            (self._which, one_of((OUTCOME, SLIDING))),
            (self._shown, is_switch),
            (self._play, is_switch),
            (self._time, number_between(0.0, 1.0)),
        ):
            gate.admit(control, check)
            control.on_update(lambda _: self._draw())
        self._play.on_update(lambda _: self._show_what_plays())
        self._thread = threading.Thread(target=self._run, name="graspless-player", daemon=True)
        self._thread.start()

    def set(self, picture: Picture, motions: Mapping[str, MovingPicture]) -> None:
        """Draw a picture, and offer motions in its stead, by name."""
        with self._lock:
            new = tuple(motions) != tuple(self._motions)
            self._picture, self._motions = picture, motions
            self._folder.visible = bool(motions)
            if not motions:
                self._shown.value = self._play.value = False
            elif new:
                self._which.options = tuple(motions)
                self._which.value = next(iter(motions))
            self._draw()

    @property
    def _moving(self) -> MovingPicture | None:
        """The motion that is chosen; None: none is shown."""
        return self._motions.get(self._which.value) if self._shown.value else None

    def stop(self) -> None:
        """End the thread."""
        self._stopped.set()
        self._thread.join()

    def _show_what_plays(self) -> None:
        if self._play.value:
            self._shown.value = True

    def _draw(self) -> None:
        """Draw the picture, or the motion at its time."""
        with self._lock, self._server.atomic():
            moving = self._moving
            if moving is not None:
                self._stage.draw(moving.picture)
                self._stage.move(moving, round(self._time.value * (len(moving.times) - 1)))
            elif self._picture is not None:
                self._stage.draw(self._picture)

    def _run(self) -> None:
        """Play frame by frame until the page is stopped."""
        frame = 0
        while not self._stopped.wait(_FRAME):
            with self._lock, self._server.atomic():
                moving = self._moving
                if moving is not None and self._play.value:
                    last = len(moving.times) - 1
                    frame = (frame + 1) % (last + _STILL_FRAMES)
                    self._stage.move(moving, min(frame, last))
