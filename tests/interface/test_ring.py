"""Rings hand large observations over to the writer with one copy and bounded memory."""

import threading
import time
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from gamekeeper.episodes.buffer import LargePlace
from gamekeeper.episodes.encoder import Encoder
from gamekeeper.interface import packing as ring_module
from gamekeeper.interface.packing import Ring, Rings
from gamekeeper.interface.recorded_env import capture_of, recorded_of
from gamekeeper.rollouts.memory import MemorySink
from tests.interface.capture_games import (
    IDENTITY,
    ScriptedAEC,
    ScriptedParallel,
    ScriptError,
    Turn,
    evidence_of,
    recorded,
)

IMAGE = Box(0, 255, (64, 48, 3), np.uint8)


class RingSink(MemorySink):
    """Evidence in memory that puts large observations aside, as a recorder does."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.rings = Rings()
        self._encoder = Encoder(self.layout, self.rings.open)


class Drawn:
    """Observations of an image space in several memory layouts, distinct at every turn."""

    def observation_space(self, agent: str) -> Any:
        return IMAGE

    def look(self, agent: str) -> Any:
        rng = np.random.default_rng([self.turn, int(agent[-1])])  # type: ignore[attr-defined]
        image = rng.integers(0, 256, (48, 64, 3), np.uint8)
        return image.swapaxes(0, 1)  # as pygame's surfarray gives it


class DrawnParallel(Drawn, ScriptedParallel):
    pass


class DrawnAEC(Drawn, ScriptedAEC):
    pass


ARRAYS = st.sampled_from(["u1", "i2", "<f4", "f8", "?"]).flatmap(
    lambda dtype: npst.arrays(dtype, npst.array_shapes(max_dims=4, max_side=5))
)


@settings(max_examples=20)
@given(ARRAYS, st.data())
def test_ring_gives_the_c_bytes_of_any_memory_layout(array: Any, data: st.DataObject) -> None:
    """Transposed, reversed and sliced arrays come out as their C bytes."""
    axes = data.draw(st.permutations(range(array.ndim)))
    source = array.transpose(axes)[::-1]
    rings = Rings()
    for value in (source, source.copy(), np.asfortranarray(source)):
        place = rings.put(value)
        assert type(place) is LargePlace
        assert rings.copy(place) == source.tobytes()
        out = np.zeros(source.nbytes, np.uint8)
        rings.open(place, out)
        assert out.tobytes() == source.tobytes()


def test_ring_that_is_full_says_so_and_reuses_what_is_freed() -> None:
    """The slot freed last is used first, so that idle slots are never touched."""
    array = np.arange(10_000, dtype=np.uint8)
    ring = Ring(array)
    slots = []
    while (slot := ring.put(array)) is not None:
        slots.append(slot)
    assert len(set(slots)) == ring_module.MEMORY_BYTES // array.nbytes
    ring.release(slots[3])
    assert ring.put(array) == slots[3]
    assert ring.put(array) is None


def test_arrays_of_other_kinds_have_rings_of_their_own() -> None:
    """Dtype and shape decide."""
    rings = Rings()
    arrays = [
        np.full(9000, 1, np.uint8),
        np.full(9000, 2, np.int16),
        np.full((90, 100), 3, np.uint8),
    ]
    places = [rings.put(array) for array in arrays]
    assert len(set(places)) == 3
    assert [array.tobytes() for array in arrays] == [rings.copy(place) for place in places]  # type: ignore[arg-type]


@pytest.mark.parametrize("cls", [DrawnParallel, DrawnAEC])
def test_run_through_rings_equals_the_run_in_memory(cls: Any) -> None:
    """Raises, repeated looks, and rows begun otherwise than usual included."""
    prints = []
    script = [Turn(), Turn(raises=True), Turn(ends=((1, True),)), Turn(pays=((0, np.float64(1)),))]
    for sink in (MemorySink(), RingSink()):
        wrapped = recorded_of(capture_of(cls(script), sink=sink))
        _play(wrapped)
        wrapped._capture.end_episode()
        evidence = sink.evidence(IDENTITY)
        prints.append(evidence.fingerprint)
        for ring in sink.rings._rings if sink.rings is not None else ():
            assert len(ring._slots) == len(ring._free)  # every slot comes back
        turn = evidence.episode(0).turns[2]
        assert all(value.shape == IMAGE.shape for value in turn.observations.values())
    assert prints[0] == prints[1]


def _play(wrapped: Any) -> None:
    wrapped.reset(seed=1)
    for _ in range(8):
        if not wrapped.agents:
            return
        try:
            if isinstance(wrapped.unwrapped, ScriptedParallel):
                wrapped.step(dict.fromkeys(wrapped.agents, np.int64(1)))
            else:
                for _ in range(2):
                    seen = wrapped.last()
                wrapped.observe(wrapped.agents[-1])
                wrapped.step(None if seen[2] or seen[3] else np.int64(1))
        except ScriptError:
            continue


def test_big_endian_images_are_no_oddity() -> None:
    """They go as bytes, in the order of bytes that columns have."""

    class Swapped(ScriptedParallel):
        space = Box(-1, 1, (3000,), np.dtype(">f4"))  # type: ignore[arg-type]

        def observation_space(self, agent: str) -> Any:
            return self.space

        def look(self, agent: str) -> Any:
            return np.linspace(0, 1, 3000).astype(">f4")

    sink = RingSink()
    wrapped = recorded_of(capture_of(Swapped([Turn()]), sink=sink))
    wrapped.reset(seed=1)
    turn = evidence_of(wrapped, sink).episode(0).turns[0]
    assert turn.nonconforming == {}
    assert turn.observations["agent_0"].dtype == np.dtype(">f4")


def test_turn_with_more_large_observations_than_slots_does_not_wait_for_itself(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Nobody frees a slot for a turn that isn't on the buffer yet: the rest go as bytes."""
    monkeypatch.setattr(ring_module, "MEMORY_BYTES", 1)
    monkeypatch.setattr(ring_module, "FEWEST", 2)

    sink = RingSink()
    wrapped = recorded_of(capture_of(DrawnParallel([Turn()]), sink=sink))
    wrapped.reset(seed=1)
    whole, memory = recorded(DrawnParallel([Turn()]))
    whole.reset(seed=1)
    assert evidence_of(wrapped, sink).fingerprint == evidence_of(whole, memory).fingerprint


def test_full_ring_holds_the_step_back_until_the_writer_frees_a_slot(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A slow writer in another thread: nothing is lost, nothing mixed up."""
    monkeypatch.setattr(ring_module, "MEMORY_BYTES", 1)
    monkeypatch.setattr(ring_module, "FEWEST", 6)

    sink = RingSink()
    wrapped = recorded_of(capture_of(DrawnParallel([Turn()]), sink=sink))
    done = threading.Event()

    def write() -> None:
        while not done.is_set():
            sink._drain()
            time.sleep(0.001)  # slower than the steps, which is what is tested

    writer = threading.Thread(target=write)
    writer.start()
    try:
        wrapped.reset(seed=1)
        for _ in range(60):
            wrapped.step(dict.fromkeys(wrapped.agents, np.int64(1)))
    finally:
        done.set()
        writer.join()
    evidence = evidence_of(wrapped, sink)
    whole, memory = recorded(DrawnParallel([Turn()]))
    whole.reset(seed=1)
    for _ in range(60):
        whole.step(dict.fromkeys(whole.agents, np.int64(1)))
    assert evidence.fingerprint == evidence_of(whole, memory).fingerprint
    assert all(len(ring._slots) == 6 for ring in sink.rings._rings)  # type: ignore[union-attr]


def test_step_says_that_the_writer_failed_where_it_waits_for_a_slot(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A writer that is gone frees nothing; without the question the step would wait for ever."""
    monkeypatch.setattr(ring_module, "MEMORY_BYTES", 1)
    monkeypatch.setattr(ring_module, "FEWEST", 3)

    class Broken(RingSink):
        def keep_up(self) -> None:
            raise OSError("no space left")

    wrapped = recorded_of(capture_of(DrawnParallel([Turn()]), sink=Broken()))
    wrapped.reset(seed=1)
    with pytest.raises(OSError, match="no space left"):
        wrapped.step(dict.fromkeys(wrapped.agents, np.int64(1)))
