"""The renderers of one scene: created on demand, made anew after a failure, and replaced.

Belongs to the thread that made the first renderer: OpenGL contexts are bound to threads.
"""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, cast

from catoptra_protocol.errors import RendererUnavailableError
from catoptra_server.planning.renderer_choice import RendererChoice
from catoptra_server.render.renderer import Renderer
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.runtime.faults import log_fault

if TYPE_CHECKING:
    from catoptra_server.render.trace import TraceRenderer

log = logging.getLogger(__name__)

# Faces have texels of their own: rays alone meet the model's exact surfaces.
_TRACING_KIND = next(kind for kind in RendererKind if not kind.uses_faces)


class RendererPool:
    """The chosen renderer of a server and its alternatives."""

    def __init__(self, choice: RendererChoice, *, may_replace: bool = True) -> None:
        """Take over the chosen renderer.

        Args:
            choice: Renderer, with the factories of this one and of the others.
            may_replace: Whether an alternative may replace a renderer that fails; not under
                lockstep, where the same commands give the same bytes.
        """
        self._choice = choice
        self._renderers: dict[RendererKind, Renderer] = {choice.kind: choice.renderer}
        self._factories = dict(choice.factories)
        self._may_replace = may_replace
        self._default_kind = choice.kind
        self._replaced: dict[RendererKind, RendererKind] = {}
        self._tracer: Renderer | None = None

    @property
    def default_kind(self) -> RendererKind:
        """Kind of the renderer for cameras without an accuracy target."""
        return self._default_kind

    @property
    def reason(self) -> str:
        """Reason of that kind."""
        return ": ".join(filter(None, (self.replacement_note, self._choice.reason)))

    def is_usable(self, kind: RendererKind) -> bool:
        """Whether a renderer of a kind exists or can be created, and has not been replaced."""
        return kind not in self._replaced and kind in {*self._renderers, *self._factories}

    @property
    def replacement_note(self) -> str:
        """Replacements in words; empty for none."""
        return ", ".join(
            f"{other.value} in place of {failed.value}, which failed"
            for failed, other in self._replaced.items()
        )

    def get(self, kind: RendererKind) -> Renderer:
        """Renderer of a kind, created at the first call and at the first one after `renew`.

        Raises:
            RendererUnavailableError: The renderer cannot run on this machine.
        """
        if kind not in self._renderers:
            self._renderers[kind] = self._factories[kind]()
            log.info("%s", self._renderers[kind].describe())
        return self._renderers[kind]

    def get_tracer(self) -> TraceRenderer:
        """Renderer whose rays label frames: the one that draws, or one of its own.

        Raises:
            RendererUnavailableError: No ray can be traced on this machine.
        """
        if _TRACING_KIND in self._renderers:
            return cast("TraceRenderer", self._renderers[_TRACING_KIND])
        if self._tracer is None:
            if self._choice.tracer is None:
                raise RendererUnavailableError("this server has no renderer that traces rays")
            self._tracer = self._choice.tracer()
            log.info("labels by %s", self._tracer.describe())
        return cast("TraceRenderer", self._tracer)

    def describe(self, kind: RendererKind) -> str:
        """Description of a renderer, with engine and device; creates it."""
        return self.get(kind).describe()

    def create_all(self) -> list[RendererKind]:
        """Create all renderers; one that cannot be created is no longer an alternative.

        Returns:
            Kinds that may be used.
        """
        usable = []
        for kind in RendererKind:
            if not self.is_usable(kind):
                continue
            try:
                self.get(kind)
                usable.append(kind)
            except RendererUnavailableError as error:
                del self._factories[kind]
                log.info("%s is not available: %s", kind.value, error)
        return usable

    def renew(self, kind: RendererKind) -> None:
        """Close a renderer, whose views must be closed before; the next use creates it anew."""
        # Without a factory the old one may still render other views.
        if kind in self._factories and kind in self._renderers:
            _close(self._renderers.pop(kind))

    def find_replacement(self, kind: RendererKind) -> RendererKind | None:
        """Kind that may replace a failed one; None under lockstep or after a choice by name."""
        # A renderer requested by name has no alternatives.
        others = (other for other in self._factories if other not in (kind, *self._replaced))
        return next(others, None) if self._may_replace else None

    def replace(self, kind: RendererKind, other: RendererKind) -> None:
        """Use a renderer of another kind in place of a failed one."""
        self._replaced[kind] = other
        self._default_kind = other if self._default_kind is kind else self._default_kind

    def restore(self, kind: RendererKind) -> None:
        """Undo a replacement."""
        self._replaced.pop(kind)
        if self._choice.kind not in self._replaced:
            self._default_kind = self._choice.kind

    def close(self) -> None:
        """Close all renderers."""
        for renderer in self._renderers.values():
            _close(renderer)
        self._renderers.clear()
        if self._tracer is not None:
            _close(self._tracer)
        self._tracer = None


def _close(renderer: Renderer) -> None:
    try:
        renderer.close()
    except Exception:
        # A lost device cannot always be closed; the server needs nothing of it any more.
        log_fault(log, "a renderer could not be closed")
