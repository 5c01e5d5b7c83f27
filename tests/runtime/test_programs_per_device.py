"""Functions compiled for several devices, and calls in one thread per device."""

import itertools
import threading

import jax
import numpy as np
import pytest
from jaxtyping import Array

from rpojax.runtime import programs_per_device


def test_every_device_computes_with_its_own_arguments_and_donates_them() -> None:
    def grow(factor: Array, state: Array) -> Array:
        return factor * state

    devices = jax.devices()
    arguments = [(np.float64(2.0), np.arange(5.0) + number) for number in range(len(devices))]
    programs = programs_per_device.trace_for_devices(grow, arguments[0], devices, donate=(1,)).compile()
    placed = programs.place(arguments)
    results = programs.call(placed)
    for number, (result, target) in enumerate(zip(results, programs.targets, strict=True)):
        np.testing.assert_array_equal(result, 2.0 * (np.arange(5.0) + number))
        assert result.devices() == {target}
    assert all(state.is_deleted() and not factor.is_deleted() for factor, state in placed)


def test_results_in_memory_of_the_host_are_those_of_the_device(monkeypatch: pytest.MonkeyPatch) -> None:
    arrays = {"a": jax.numpy.arange(6.0).reshape(2, 3), "b": jax.numpy.array([True, False])}
    assert programs_per_device.copied_to_host(arrays) is arrays

    monkeypatch.setattr(programs_per_device, "_computes_in_memory_of_the_host", lambda device: False)
    copies = programs_per_device.copied_to_host(arrays)
    for name, each in copies.items():
        assert each.sharding.memory_kind == "pinned_host"
        np.testing.assert_array_equal(each, arrays[name])


def test_cores_of_a_cpu_share_one_trace_and_one_program() -> None:
    traces = []

    def square(x: Array) -> Array:
        traces.append(x.shape)
        return x * x

    devices = [jax.devices("cpu")[0]] * 3
    traced = programs_per_device.trace_for_devices(square, (jax.ShapeDtypeStruct((4,), np.float64),), devices)
    assert traces == [(4,)]
    assert (traced.outputs.shape, traced.outputs.dtype) == ((4,), np.float64)
    assert len({id(program) for program in traced.compile().programs}) == 1


def test_no_more_devices_than_runs_and_no_more_runs_than_they_take() -> None:
    devices = ["a", "b", "c"]
    assert programs_per_device.share_runs(2, 10, devices) == (["a", "b"], 1)
    assert programs_per_device.share_runs(7, 10, devices) == (devices, 3)
    assert programs_per_device.share_runs(100, 10, devices) == (devices, 10)
    assert programs_per_device.choose_devices() == jax.devices()
    assert programs_per_device.choose_devices(devices, most=1) == ["a"]


def test_thread_runs_ahead_of_a_slow_one_but_not_far_ahead_of_the_caller() -> None:
    counted, third, released = itertools.count(1), threading.Event(), threading.Event()
    calls: list[int] = []

    def fast() -> int:
        calls.append(next(counted))
        if len(calls) == programs_per_device.CALLS_AHEAD + 1:
            third.set()
        return calls[-1]

    def slow() -> bool:
        return released.wait(30.0)

    results = programs_per_device.call_in_threads([fast, slow], 10)
    begun = threading.Thread(target=next, args=(results,))
    begun.start()
    assert third.wait(30.0)  # before the other has its first result
    released.set()
    begun.join()
    results.close()
    assert len(calls) == programs_per_device.CALLS_AHEAD + 1
    assert list(programs_per_device.call_in_threads([lambda: next(counted)], 3)) == [[4], [5], [6]]


def test_error_in_a_thread_is_raised_in_the_caller() -> None:
    def fail() -> float:
        raise ValueError("device lost")

    before = set(threading.enumerate())
    with pytest.raises(ValueError, match="device lost"):
        next(programs_per_device.call_in_threads([lambda: 1.0, fail], 4))
    assert set(threading.enumerate()) <= before
