"""Units of work on Ray: the same results as in local processes, whatever dies."""

import os
import threading
import time
from pathlib import Path

import pytest

pytest.importorskip("ray", reason="Ray is not installed: pip install 'entrack[cluster]'")

import ray

import stub_trackers
from entrack.errors import EntrackError
from entrack.evaluation.cluster import run_on_cluster
from entrack.evaluation.parcel import pack
from entrack.evaluation.pool import run_units
from entrack.model import load_model, save_model
from small_data import black_out, evaluate, make_folder

pytestmark = pytest.mark.xdist_group("ray")
"""One process of tests has all of them: a second would join its cluster, not start its own."""


@pytest.fixture(scope="module")
def stub_folder(tmp_path_factory):
    """Where stubs on Ray look for what they are told; known before its workers start."""
    return tmp_path_factory.mktemp("stubs")


@pytest.fixture(scope="module")
def cluster(stub_folder):
    patch = pytest.MonkeyPatch()
    patch.setenv("STUB_FOLDER", str(stub_folder))
    paths = [str(Path(__file__).parent), *os.environ.get("PYTHONPATH", "").split(os.pathsep)]
    patch.setenv("PYTHONPATH", os.pathsep.join(paths))
    patch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    quiet = {"include_dashboard": False, "log_to_driver": False}
    ray.init("local", num_cpus=2, _node_ip_address="127.0.0.1", **quiet)
    yield "auto"
    ray.shutdown()
    patch.undo()


@pytest.fixture
def data(tmp_path):
    return make_folder(tmp_path / "data")


def on_ray(numbers, **options):
    return list(run_on_cluster(stub_trackers.square, numbers, "auto", **options))


def results(out: Path) -> dict[str, bytes]:
    return {
        p.relative_to(out).as_posix(): p.read_bytes()
        for p in out.rglob("*.txt")
        if "time" not in p.name
    }


def test_events_are_those_of_the_local_pool(cluster):
    def ends(events):
        found = [(e.unit, e.kind, str(e.value).splitlines()[0]) for e in events]
        return sorted(e for e in found if e[1] != "progress")

    numbers = [7, 2, 3, 4, 5]
    assert ends(on_ray(numbers)) == ends(run_units(stub_trackers.square, numbers, 2))


def test_a_unit_that_kills_its_worker_three_times_is_left_out(cluster):
    found = on_ray([13, 2, 3], workers=1)
    assert [e.unit for e in found if e.kind == "again"] == [0, 0]
    (failed,) = [e for e in found if e.kind == "failed"]
    assert (failed.unit, failed.value) == (0, "its worker died (WorkerCrashedError), 3 times")
    assert sorted(e.value for e in found if e.kind == "done") == [4, 9]


def test_an_evaluation_has_the_results_of_local_processes(cluster, data, tmp_path):
    for name, options in {"local": {"workers": 2}, "ray": {"cluster": cluster}}.items():
        evaluate(data, "Drift", "opencv:mil", out=tmp_path / name, **options)
    found = results(tmp_path / "ray")
    assert len(found) == 6
    assert found == results(tmp_path / "local")


def test_a_worker_killed_on_the_way_changes_no_result(cluster, data, stub_folder, tmp_path):
    black_out(data, "first")
    (stub_folder / "lives").write_text("0")
    evaluate(data, "Deadly", out=tmp_path / "whole", cluster=cluster)
    (stub_folder / "lives").write_text("1")
    outcome = evaluate(data, "Deadly", out=tmp_path / "killed", cluster=cluster)
    assert (stub_folder / "lives").read_text() == "0"
    assert outcome.failed == {}
    assert results(tmp_path / "killed") == results(tmp_path / "whole")


def test_a_model_folder_is_unpacked_once_where_the_work_is(cluster, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "elsewhere"))
    (tmp_path / "elsewhere").mkdir()
    shipped = load_model("cf")
    save_model(tmp_path / "a" / "model", "mine", "", shipped.config, shipped.trunk)
    parcel, files = pack(str(tmp_path / "a" / "model"))
    calls = []
    places = {parcel.unpack(lambda: calls.append(1) or files) for _ in range(3)}
    assert calls == [1]
    assert load_model(places.pop()).checksum == parcel.checksum
    (tmp_path / "elsewhere").rename(tmp_path / "gone")
    changed = {name: data + b"\n" for name, data in files.items()}
    (tmp_path / "elsewhere").mkdir()
    with pytest.raises(EntrackError, match="another model"):
        parcel.unpack(lambda: changed)


def test_results_that_are_not_here_are_a_failure(cluster, data, tmp_path, monkeypatch):
    monkeypatch.setattr("entrack.evaluation.run.run_unit", stub_trackers.nothing)
    outcome = evaluate(data, "Still", out=tmp_path / "out", cluster=cluster)
    assert len(outcome.failed) == 3
    assert "do all machines see this folder?" in next(iter(outcome.failed.values()))


def test_a_cluster_that_cannot_do_it_is_refused(cluster):
    with pytest.raises(EntrackError, match="no machine of the cluster has 64 CPUs, at most 2"):
        on_ray([1], threads=64)


def test_a_ray_that_does_not_start_is_one_sentence(cluster, monkeypatch):
    def too_slow(*args, **options):
        raise Exception("The current node timed out during startup.")

    monkeypatch.setattr(ray, "is_initialized", lambda: False)
    monkeypatch.setattr(ray, "init", too_slow)
    with pytest.raises(EntrackError, match="Ray did not start on this machine: The current node"):
        list(run_on_cluster(stub_trackers.square, [1], "local"))


def test_a_machine_that_is_lost_has_its_units_done_by_others(tmp_path):
    """Runs last: it starts a cluster of two machines of its own."""
    from ray.cluster_utils import Cluster

    ray.shutdown()
    machines = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    try:
        lost = machines.add_node(num_cpus=1)
        ray.init(machines.address, log_to_driver=False)
        payloads = [(str(tmp_path), number) for number in range(8)]

        def kill():
            while len(list(tmp_path.iterdir())) < 2:
                time.sleep(0.05)
            machines.remove_node(lost, allow_graceful=False)

        killer = threading.Thread(target=kill)
        killer.start()
        events = list(run_on_cluster(stub_trackers.slow_square, payloads, "auto"))
        killer.join()
        done = {e.unit: e.value for e in events if e.kind == "done"}
        assert done == {n: n * n for n in range(8)}
        assert [e for e in events if e.kind == "again"]
    finally:
        ray.shutdown()
        machines.shutdown()
