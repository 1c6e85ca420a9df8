# SPDX-License-Identifier: Apache-2.0
"""Survey: who computes, and what is kept between runs."""

import json
import logging
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import cv2
import numpy as np
import pytest
from support import tasks
from support.photographs import model
from support.survey_views import camera_at, unplaced, view

from fcsv_stereo.errors import InputError, OutputError, SurveyError
from fcsv_stereo.survey import similarity, survey
from fcsv_stereo.survey.edges.edge import Edge
from fcsv_stereo.survey.lock import LOCK, alone_in
from fcsv_stereo.survey.placing.adjust import adjust
from fcsv_stereo.survey.tasks import edge_files
from fcsv_stereo.survey.tasks.crew import Crew, SurveyTask, WorkOptions
from fcsv_stereo.survey.tasks.edge_files import kept_edge, make_edge
from fcsv_stereo.survey.tasks.progress import MapsProgress
from fcsv_stereo.survey.views import inputs
from fcsv_stereo.survey.views.view_file import view_file

pytestmark = pytest.mark.xdist_group("survey_work")


def squares(*values):
    return [SurveyTask(f"number {v}", tasks.square, (v,), long=True) for v in values]


@pytest.mark.parametrize("workers", [0, 2])
def test_all_ways_give_the_same_and_name_what_is_refused(workers):
    with Crew(WorkOptions(workers)) as crew:
        found = {o.number: o for o in crew.run(squares(2, 13, 5))}
    assert [found[i].result for i in range(3)] == [4, None, 25]
    assert [found[i].error for i in range(3)] == ["", "13 is refused", ""]


def test_workers_are_other_processes_and_few_short_tasks_need_none(tmp_path):
    def of(count, long):
        return [
            SurveyTask(str(i), tasks.write_number, (tmp_path / str(i), i), long)
            for i in range(count)
        ]

    with Crew(WorkOptions(2)) as crew:
        assert {o.result for o in crew.run(of(3, False))} == {os.getpid()}
        assert os.getpid() not in {o.result for o in crew.run(of(3, True))}
        assert os.getpid() not in {o.result for o in crew.run(of(1, False))}  # they are there now
    assert list(Crew(WorkOptions(2)).run([])) == []


def test_the_scheduler_knows_of_few_tasks_at_a_time(monkeypatch):
    monkeypatch.setattr("fcsv_stereo.survey.tasks.crew._IN_FLIGHT", 2)
    with Crew(WorkOptions(1)) as crew:
        found = {}
        for o in crew.run(squares(*range(7))):
            found[o.number] = o.result
            assert len(crew._client.futures) <= 3  # two, and that of this result
    assert found == {i: i * i for i in range(7)}


@pytest.mark.slow
def test_a_worker_that_dies_is_named_and_the_rest_is_there():
    with Crew(WorkOptions(2)) as crew:
        found = {o.number: o for o in crew.run(squares(2, 99, 5))}
    assert found[0].result == 4 and found[2].result == 25
    assert "number 99: its worker died 4 times" in found[1].error
    assert "--memory-per-worker more" in found[1].error


@pytest.mark.slow
def test_a_task_that_hangs_is_tried_again_by_a_new_worker(tmp_path):
    with Crew(WorkOptions(2, limit_s=6.0)) as crew:
        waiting = [SurveyTask("slow", tasks.hang_once, (tmp_path / "hung",), long=True)]
        found = [o.result for o in crew.run([*waiting, *squares(2)])]
    assert sorted(map(str, found)) == ["4", "done"]


@pytest.mark.slow
def test_a_task_whose_worker_is_killed_is_done_by_another(tmp_path):
    with Crew(WorkOptions(2)) as crew:
        killed = [SurveyTask("killed", tasks.die_once, (tmp_path / "once",), long=True)]
        found = {o.number: o for o in crew.run([*killed, *squares(2, 5)])}
    assert [found[i].result for i in range(3)] == ["done", 4, 25]


@pytest.mark.slow
def test_a_scheduler_that_goes_is_said_and_the_same_work_goes_on_at_another(tmp_path, caplog):
    """Workers and scheduler of the cluster are killed while it works; Dask prints no traceback."""
    logging.getLogger("distributed.client").addHandler(caplog.handler)
    program = """
import sys
from distributed import LocalCluster
if __name__ == "__main__":
    with LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address="127.0.0.1:0") as cluster:
        print(cluster.scheduler_address, flush=True)
        sys.stdin.read()
"""
    (tmp_path / "cluster.py").write_text(program)
    cluster = subprocess.Popen(
        [sys.executable, str(tmp_path / "cluster.py")],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        start_new_session=True,
    )
    address = cluster.stdout.readline().strip()
    begun = [
        SurveyTask(str(i), tasks.wait_a_little, (tmp_path / f"{i}.begun",), long=True)
        for i in range(9)
    ]
    try:
        with pytest.raises(SurveyError, match="the scheduler is gone.*the same command goes on"):
            with Crew(WorkOptions(scheduler=address)) as crew:
                for _ in crew.run(begun):
                    os.killpg(cluster.pid, signal.SIGKILL)
    finally:
        logging.getLogger("distributed.client").removeHandler(caplog.handler)
        cluster.stdin.close()
        cluster.wait()
    assert not caplog.records
    assert 1 <= len(list(tmp_path.glob("*.ended"))) < 9
    left = [t for t in begun if not t.args[0].with_suffix(".ended").exists()]
    with Crew(WorkOptions(2)) as crew:
        assert all(not o.error for o in crew.run(left))
    assert len(list(tmp_path.glob("*.ended"))) == 9


@pytest.mark.parametrize("workers", [0, 2])
def test_tasks_tell_how_far_they_are(workers):
    told = []
    telling = [SurveyTask("tells", tasks.tell, (), long=True, tells=True), *squares(2)]
    with Crew(WorkOptions(workers)) as crew:
        list(crew.run(telling, lambda *said: told.append(said)))
        ends = time.monotonic() + 10.0
        while len(told) < 2 and time.monotonic() < ends:  # an event may come after the result
            time.sleep(0.05)
    assert told == [(0, "first", 0.0), (0, "second", 0.5)]


def test_progress_of_maps_in_words():
    said, now = [], [0.0]
    progress = MapsProgress(["a", "b"], lambda *words: said.append(words), 0.7, lambda: now[0])
    progress.begin(True)
    now[0] = 10.0
    progress.advance(1, "matching roughly", 0.5)
    progress.advance(0, "refining poses", 0.0)
    progress.ended(1)
    progress.advance(1, "fusing", 0.98)  # late
    progress.ended(0)
    assert [words for words, _ in said] == [
        "0 of 2 maps, starting workers",
        "0 of 2 maps, about 30 s for the others, b: matching roughly",
        "0 of 2 maps, about 30 s for the others, a: refining poses, b: matching roughly",
        "1 of 2 maps, about 10 s for the others, a: refining poses",
        "2 of 2 maps",
    ]
    assert np.allclose([share for _, share in said], [0.0, 0.175, 0.175, 0.35, 0.7])


def test_one_survey_at_a_time_writes_to_a_folder_and_it_is_said_which(tmp_path):
    with alone_in(tmp_path / "out"):
        assert (tmp_path / "out" / LOCK).exists()
        with pytest.raises(
            OutputError, match=f"another survey writes there .process {os.getpid()}"
        ):
            with alone_in(tmp_path / "out"):
                pass
    assert list((tmp_path / "out").iterdir()) == []


def test_a_dead_survey_holds_nothing(tmp_path):
    program = f"""
import os, pathlib, signal
from fcsv_stereo.survey.lock import alone_in
with alone_in(pathlib.Path({str(tmp_path)!r})):
    os.kill(os.getpid(), signal.SIGKILL)
"""
    assert subprocess.run([sys.executable, "-c", program]).returncode == -signal.SIGKILL
    assert (tmp_path / LOCK).exists()
    with alone_in(tmp_path):
        assert json.loads((tmp_path / LOCK).read_text())["process"] == os.getpid()


def test_a_scheduler_that_is_not_there_is_said():
    with pytest.raises(SurveyError, match="no Dask scheduler at tcp://127.0.0.1:9"):
        with Crew(WorkOptions(scheduler="tcp://127.0.0.1:9")) as crew:
            list(crew.run(squares(2)))


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"workers": -1}, "--workers: is 0 or more"),
        ({"memory": "much"}, "--memory-per-worker: is as 4GB"),
        ({"memory": "1MB"}, "at least 256MiB"),
        ({"scheduler": "here"}, "--scheduler: is tcp://HOST:PORT"),
        ({"scheduler": "tcp://a:1", "workers": 2}, "has workers of its own"),
    ],
)
def test_wrong_options_are_refused(options, said):
    with pytest.raises(SurveyError, match=said):
        WorkOptions(**options)


@pytest.fixture
def three(tmp_path):
    """Views of a checked wall from three places as files, in the folders of maps."""
    found = []
    for i, y in enumerate((0.0, 1.0, 2.0)):
        v = view(f"v{i}", camera_at(0, y))
        rows, columns = np.indices(v.depth.shape)
        random = np.random.default_rng(3).integers(0, 255, (40, 40)).astype(np.uint8)
        board = random[(rows // 3) % 40, ((columns + int(4 * y)) // 3) % 40]
        v.image[:] = board[..., None]
        folder = tmp_path / v.name
        folder.mkdir()
        for what in ("depth", "sigma", "kind"):
            np.save(folder / f"{what}.npy", getattr(v, what))
        cv2.imwrite(str(folder / "reference.png"), v.image)
        c = v.camera
        reference = {n: getattr(c, n) for n in ("width", "height", "fx", "fy", "cx", "cy")}
        reference["T_home_cam"] = v.T_home_cam.tolist()
        (folder / "report.json").write_text(json.dumps({"reference": reference}))
        found.append((v, view_file(v, folder, f"content {i}")))
    return found


def edges_of(three, out, made=None, monkeypatch=None):
    if monkeypatch is not None:
        find = edge_files.find_edge
        monkeypatch.setattr(
            edge_files,
            "find_edge",
            lambda a, b, *rest: made.append((a.name, b.name)) or find(a, b, *rest),
        )
    with Crew(WorkOptions(0)) as crew:
        return survey.edges_between([f for _, f in three], out, crew, lambda *_: None, 8)


def test_edges_are_kept_and_another_view_costs_its_own(three, tmp_path, monkeypatch):
    out, made = tmp_path / "out", []
    first, missing = edges_of(three[:2], out, made, monkeypatch)
    assert made == [("v0", "v1")] and not missing and len(first) == 1
    made.clear()
    again, _ = edges_of(three, out)
    assert made == [("v0", "v2"), ("v1", "v2")]
    assert [e.a + e.b for e in again] == ["v0v1", "v0v2", "v1v2"]


def test_tasks_track_what_two_views_see_from_alike_directions(three, tmp_path):
    (_, a), (_, b) = three[:2]
    (edge,), _ = edges_of(three[:2], tmp_path / "out")
    features = [edge_files._features(v) for v in (a, b)]
    with_pixels, without = (edge_files.find_edge(a, b, *features, alike) for alike in (True, False))
    assert edge.matches == with_pixels.matches > without.matches


def test_an_edge_that_is_not_whole_or_of_other_views_is_found_again(three, tmp_path, monkeypatch):
    out, made = tmp_path / "out", []
    edges_of(three[:2], out, made, monkeypatch)
    path = edge_files.edge_path(three[0][1], three[1][1], out)
    whole = path.read_text()
    path.write_text(whole[: len(whole) // 2])
    edges_of(three[:2], out)
    assert path.read_text() == whole and len(made) == 2
    moved = view_file(three[0][0], tmp_path / "v0", "other content")
    edges_of([(three[0][0], moved), three[1]], out)
    assert len(made) == 3


def test_a_kept_edge_is_the_edge_to_the_last_bit(three, tmp_path):
    (_, a), (_, b) = three[:2]
    make_edge(a, b, tmp_path, True)
    first = kept_edge(a, b, tmp_path)
    text = edge_files.edge_path(a, b, tmp_path).read_text()
    edge_files._FEATURES.clear()
    make_edge(a, b, tmp_path, True)
    assert edge_files.edge_path(a, b, tmp_path).read_text() == text and first.matches >= 0
    found = edge_files.find_edge(a, b, *(edge_files._features(v) for v in (a, b)), True)
    assert found.matches == first.matches and found.reason == first.reason
    if found.S_a_b is not None:
        assert found.S_a_b.scale() == first.S_a_b.scale()
        assert (found.S_a_b.rotation().matrix() == first.S_a_b.rotation().matrix()).all()


def test_a_pair_whose_map_went_away_is_missing_and_the_others_are_there(three, tmp_path):
    (tmp_path / "v2/depth.npy").unlink()
    edge_files._FEATURES.clear()
    found, missing = edges_of(three, tmp_path / "out")
    assert [m.name for m in missing] == ["v0 with v2", "v1 with v2"]
    assert all("depth.npy" in m.reason for m in missing) and len(found) == 1


def posed_folder(folder):
    """COLMAP's text model of six photographs."""
    lines = [f"{i} 1 0 0 0 {-i} 0 0 1 p{i}.jpg\n\n" for i in range(6)]
    return model(folder, images="".join(lines))


def test_every_second_photograph_is_the_reference_of_a_view(tmp_path):
    folder = posed_folder(tmp_path / "walk")
    (folder / "station.yaml").write_text(
        "place_m: [1, 2, 3]\nheading_deg: 10\nplace_sigma_m: 0.5\nheading_sigma_deg: 0.1\n"
    )
    found = inputs.sources_of([folder], every=2)
    assert [s.name for s in found] == ["walk-p0", "walk-p2", "walk-p4"]
    assert [s.reference for s in found] == ["p0.jpg", "p2.jpg", "p4.jpg"]
    assert [s.station is not None for s in found] == [True, False, False]
    keys = inputs.source_keys(found)
    assert inputs.copies(keys) == {} and len(inputs.sources_of([folder])) == 1
    with pytest.raises(InputError, match="--every: is 1 or more"):
        inputs.sources_of([folder], every=-1)


def test_poses_of_one_folder_join_views_that_features_do_not():
    views = [replace(view(f"v{i}", camera_at(0, 3.0 * i)), source="walk") for i in range(3)]
    views = [replace(v, T_home_cam=camera_at(0, 3.0 * i)) for i, v in enumerate(views)]
    assert survey.with_posed([], views) == []  # their priors state it
    views = [replace(v, prior=unplaced(v.T_home_cam)) for v in views]
    lone = replace(view("lone", camera_at(50, 0)), source="other")
    refused = Edge("v0", "v1", matches=3, reason="3 features are alike")
    found = survey.with_posed([refused], [*views, lone])
    assert [(e.a, e.b, e.kept) for e in found] == [("v0", "v1", True), ("v1", "v2", True)]
    assert np.allclose(similarity.place(found[0].S_a_b), [-3.0, 0.0, 0.0])
    placed = adjust(views, found).placed
    assert len(placed) == 3
    good = replace(found[0], matches=20, residual_m=0.1)
    assert survey.with_posed([good], views)[0] is good
