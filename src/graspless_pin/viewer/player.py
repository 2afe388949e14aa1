"""The part of the page that plays what an object does that may not stay."""

from __future__ import annotations

import threading
from typing import Any

from graspless_pin.viewer.gate import Gate, is_switch, number_between
from graspless_pin.viewer.stage import Stage
from graspless_pin.visualization import Picture
from graspless_pin.visualization.motion import MovingPicture

_FRAME = 0.08  # s
_STILL_FRAMES = 10  # at the motion's end


class Player:
    """Controls that show a motion and play it, slowed, again and again, when they are asked to.

    Nothing moves before: a server does not know who wants little motion.
    """

    def __init__(self, server: Any, gate: Gate, stage: Stage) -> None:
        """Lay the controls out where the page is being built."""
        self._server, self._stage = server, stage
        self._moving: MovingPicture | None = None
        self._picture: Picture | None = None
        self._lock = threading.RLock()
        self._playing, self._stopped = threading.Event(), threading.Event()
        gui = server.gui
        self._folder = gui.add_folder("What can happen", visible=False)
        with self._folder:
            self._shown = gui.add_checkbox("show", initial_value=False)
            self._play = gui.add_checkbox("play", initial_value=False)
            self._time = gui.add_slider("time", 0.0, 1.0, 0.01, 1.0)
        gate.admit(self._shown, is_switch)
        gate.admit(self._play, is_switch)
        gate.admit(self._time, number_between(0.0, 1.0))
        self._shown.on_update(lambda _: self._switch())
        self._play.on_update(lambda _: self._start_or_stop())
        self._time.on_update(lambda _: self._show(self._time.value))
        self._thread = threading.Thread(target=self._run, name="graspless-player", daemon=True)
        self._thread.start()

    def set(self, picture: Picture, moving: MovingPicture | None) -> None:
        """Draw a picture, and offer a motion in its stead."""
        with self._lock:
            same = moving is not None and self._shown.value
            self._picture, self._moving = picture, moving
            self._folder.visible = moving is not None
            if not same:
                self._shown.value = False
                self._playing.clear()
                self._play.value = False
            self._switch()

    def stop(self) -> None:
        """End the thread."""
        self._stopped.set()
        self._playing.set()
        self._thread.join()

    def _switch(self) -> None:
        with self._lock:
            if self._picture is None:
                return
            shows = self._moving is not None and self._shown.value
            with self._server.atomic():
                self._stage.draw(self._moving.picture if shows and self._moving else self._picture)
            if shows:
                self._show(self._time.value)
            else:
                self._playing.clear()

    def _start_or_stop(self) -> None:
        with self._lock:
            if not self._play.value:
                self._playing.clear()
                return
            if not self._shown.value:
                self._shown.value = True
                self._switch()
            self._playing.set()

    def _show(self, share: float) -> None:
        with self._lock:
            if self._moving is not None and self._shown.value:
                index = round(share * (len(self._moving.times) - 1))
                with self._server.atomic():
                    self._stage.move(self._moving, index)

    def _run(self) -> None:
        """Play frame by frame until the page is stopped."""
        frame = 0
        while True:
            self._playing.wait()
            if self._stopped.wait(_FRAME):
                return
            with self._lock:
                if not self._playing.is_set() or self._moving is None:
                    self._playing.clear()
                    continue
                last = len(self._moving.times) - 1
                frame = (frame + 1) % (last + _STILL_FRAMES)
                self._show(min(frame, last) / last)
