"""The page and its controls, served by `viser` to browsers on this machine alone."""

from __future__ import annotations

import io
import threading
from collections.abc import Sequence
from contextlib import redirect_stdout
from types import TracebackType
from typing import Any

import numpy as np

from marssim.base.command.wording import counted
from marssim.base.files.markdown import as_text
from marssim.base.view.drawing import Drawing
from marssim.base.view.placing import moved_along, point_size, reach_of, stands
from marssim.base.view.scene import Layer, Shot

HOST = "127.0.0.1"  # users of other machines need an ssh tunnel
PORT = 8080  # where it is in use, the next free one is taken
NO_CHOICE, NO_LAYER = ("none",), Layer(np.zeros((0, 3), np.uint8), "")  # of a shot without points
SIZES = 0.5, 100.0  # [mm] least and largest size of points


class Page:
    """A page that shows shots. It is a context manager; the page is served until the end of the block.

    Attributes:
        address: Where a browser finds it.

    Args:
        shots: What it shows, at least one.
        title: Its title.
        port: First port that is tried; 0 takes any.

    Raises:
        ValueError, OSError: The first shot cannot be read.
    """

    def __init__(self, shots: Sequence[Shot], title: str, port: int = PORT) -> None:
        import viser  # an extra

        self._shots, self._shot, self._view = shots, shots[0], shots[0].load()
        self._lock = threading.RLock()
        with redirect_stdout(io.StringIO()):  # viser prints a table of addresses
            self._server: Any = viser.ViserServer(HOST, port, verbose=False)
        self.address = f"http://{HOST}:{self._server.get_port()}"
        self._server.scene.set_up_direction("+z")
        self._drawing = Drawing(self._server.scene)
        self._boxes: dict[str, Any] = {}
        self._has_path, self._has_size = False, False
        self._add_controls(title)
        self._draw_path()
        self._draw()
        camera = self._server.initial_camera
        camera.position, camera.look_at = self._stands()["From behind"]

    def __enter__(self) -> Page:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the page."""
        with redirect_stdout(io.StringIO()):
            self._server.stop()

    def _add_controls(self, title: str) -> None:
        gui, view, number = self._server.gui, self._view, len(self._shots)
        gui.configure_theme(show_logo=False, show_share_button=False)
        gui.main_panel.dock_right()
        gui.set_panel_label(title)
        self._slider = gui.add_slider("Shot", 1, max(2, number), 1, 1, visible=number > 1)
        self._slider.on_update(lambda _: self._go())
        self._name = gui.add_markdown("")
        self._colour = gui.add_dropdown("Colour", tuple(view.layers) or NO_CHOICE)
        self._colour.on_update(lambda _: self._recolour())
        self._legend = gui.add_markdown("")
        self._size = gui.add_slider("Point size [mm]", *SIZES, 0.5, SIZES[0])
        self._size.on_update(lambda _: self._resize())
        self._switches = gui.add_folder("Show")
        self._follow = gui.add_checkbox("Follow the camera", True, visible=number > 1)
        for name in stands(self._shot.pose, 1.0):
            gui.add_button(name).on_click(lambda event, name=name: self._stand(event.client, name))

    def _stands(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        return stands(self._shot.pose, reach_of(self._view))

    def _stand(self, client: Any, name: str) -> None:
        """Place the viewer where a button says."""
        _place(client, *self._stands()[name])

    def _go(self) -> None:
        """Go to the shot of the slider. While one is read, the slider may move on; those between are left out."""
        with self._lock:
            before, shot = self._shot, self._shots[self._slider.value - 1]
            if shot is before:
                self._name.content = self._about  # another shot may not have been shown since
                return
            try:
                view = shot.load()
            except (ValueError, OSError) as error:
                self._name.content = f"**{as_text(shot.name)}** cannot be shown: {as_text(str(error))}"
                return
            self._shot, self._view = shot, view
            with self._server.atomic():
                if shot.world != before.world:
                    self._draw_path()
                self._draw()
            if self._follow.value:
                for client in self._server.get_clients().values():
                    places = np.stack([client.camera.position, client.camera.look_at])
                    _place(client, *moved_along(places, before.pose, shot.pose))

    def _draw(self) -> None:
        """Show the current shot."""
        view, pose = self._view, self._shot.pose
        has_points = len(view.points) > 0
        self._drawing.remove_cloud()  # before the controls change, so that they change nothing of the last shot's
        choices, chosen = tuple(view.layers) or NO_CHOICE, self._colour.value
        if self._colour.options != choices:
            self._colour.options = choices
            self._colour.value = chosen if chosen in choices else choices[0]
        for control in (self._colour, self._legend, self._size):
            control.visible = has_points
        if has_points and not self._has_size:  # of the first points; from then on the user sets it
            size = float(np.clip(1000 * point_size(view), *SIZES))
            self._size.value, self._has_size = round(2 * size) / 2, True
        self._drawing.draw_cloud(view, self._layer, pose, self._size.value / 1000)
        self._drawing.draw_cameras(view, pose)
        self._drawing.draw_parts(view)
        self._legend.content = self._layer.legend
        notes = [counted(len(view.points), "point")] if view.layers else []
        self._about = f"**{as_text(self._shot.name)}** {'; '.join([*notes, as_text(view.note)])}".removesuffix("; ")
        self._name.content = self._about
        groups = ["Cloud"] * has_points + ["Cameras"] + ["Path"] * self._has_path
        self._show_switches([*groups, *(part.name for part in view.parts)])

    def _draw_path(self) -> None:
        """Show the path through the shots of the current world."""
        numbers = [number for number, shot in enumerate(self._shots) if shot.world == self._shot.world]
        self._drawing.draw_path(self._shots, numbers, self._view, self._jump)
        self._has_path = len(numbers) > 1

    def _jump(self, number: int) -> None:
        self._slider.value = number + 1

    def _show_switches(self, names: Sequence[str]) -> None:
        """Show the checkboxes of these groups alone. A group that has none yet gets one."""
        for name in names:
            if name not in self._boxes:
                self._add_switch(name)
        for name, box in self._boxes.items():
            box.visible = name in names

    def _add_switch(self, name: str) -> None:
        group = self._drawing.group(name)
        with self._switches:
            self._boxes[name] = box = self._server.gui.add_checkbox(name, True)
        box.on_update(lambda _: setattr(group, "visible", box.value))

    @property
    def _layer(self) -> Layer:
        return self._view.layers.get(self._colour.value, NO_LAYER)

    def _recolour(self) -> None:
        with self._lock:
            self._drawing.recolour(self._layer)
            self._legend.content = self._layer.legend

    def _resize(self) -> None:
        with self._lock:
            self._drawing.resize(self._size.value / 1000)


def _place(client: Any, position: np.ndarray, target: np.ndarray) -> None:
    """Move a viewer, and turn it to a point."""
    with client.atomic():
        client.camera.position = position
        client.camera.look_at = target
