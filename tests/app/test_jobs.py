"""Jobs of the app: processes of their own that wait for a core, are cancelled, die, or cannot begin."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from app_served import PATIENCE, desk_with_a_record

from twin.app import jobs as jobs_module
from twin.app.entries import Setting
from twin.app.jobs import CANCELLED, FAILED, WAITING, Jobs


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    """A session with a record."""
    made = desk_with_a_record(tmp_path_factory.mktemp("jobs"))
    yield made
    made.close()


def alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().split(") ")[1][0] != "Z"
    except OSError:
        return False


def test_cancel_ends_a_fit_at_once_and_leaves_no_process_and_no_model(desk):
    before = dict(desk.session.models)
    job = desk.fit("d1", Setting(structure="hammerstein_wiener", starts=1000))
    end = time.monotonic() + PATIENCE
    while not job.progress.startswith(("fitting", "search")) and time.monotonic() < end:
        time.sleep(0.05)
    assert job.process is not None
    pid = job.process.pid
    assert alive(pid)
    began = time.monotonic()
    desk.jobs.cancel(job)
    assert time.monotonic() - began < 30.0  # of a search that would last for hours
    assert job.state == CANCELLED
    assert not alive(pid)
    time.sleep(0.2)
    assert desk.session.models == before
    assert not job.out.exists()


def test_no_job_outlives_an_app_that_is_killed(desk, tmp_path):
    """The worker ends when the other end of its standard input closes, whatever it is doing."""
    request = {**desk._request("fit", "d1"), "out": str(tmp_path), "name": "x"}
    request["setting"] = Setting(structure="hammerstein_wiener", starts=1000).model_dump(mode="json")
    code = (
        "import subprocess, sys, time\n"
        "p = subprocess.Popen([sys.executable, '-m', 'twin.app.tasks'], stdin=-1, stdout=-1, text=True,"
        " start_new_session=True)\n"
        "p.stdin.write(sys.argv[1] + chr(10)); p.stdin.flush()\n"
        "p.stdout.readline(); print(p.pid, flush=True); time.sleep(600)\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", code, json.dumps(request)], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    pid = int(parent.stdout.readline())
    assert alive(pid)
    parent.kill()
    parent.wait()
    parent.stdout.close()
    end = time.monotonic() + PATIENCE
    while alive(pid) and time.monotonic() < end:
        time.sleep(0.1)
    assert not alive(pid)


def test_jobs_wait_for_a_core_and_closing_ends_them_all(desk):
    jobs = Jobs(1)
    request = {**desk._request("fit", "d1"), "name": "x"}
    request["setting"] = Setting(structure="hammerstein_wiener", starts=1000).model_dump(mode="json")
    first, second = (jobs.submit("x", request, lambda job, said: None) for _ in range(2))
    assert (first.state, second.state) == ("running", "waiting")
    assert second.process is None
    jobs.cancel(second)
    assert second.state == CANCELLED
    jobs.close()
    assert first.state == CANCELLED
    assert first.process is not None
    assert not alive(first.process.pid)
    assert not first.out.exists()


def test_a_process_that_dies_is_a_sentence(desk):
    job = desk.fit("d1", Setting(structure="hammerstein_wiener", starts=1000))
    end = time.monotonic() + PATIENCE
    while not job.progress.startswith(("fitting", "search", "reading")) and time.monotonic() < end:
        time.sleep(0.05)
    assert job.process is not None
    os.kill(job.process.pid, 9)
    while not job.over:
        time.sleep(0.05)
    assert job.state == FAILED
    assert "ended the process of this job (signal 9)" in job.error
    assert "resample" in job.error
    desk.jobs.forget(job)


def test_a_job_that_failed_has_told_why_before_it_says_so():
    """Whoever saw FAILED found no reason yet, now and then: the reason came after it."""
    jobs, states = Jobs(1), []
    job = jobs.submit("x", {"task": "nothing"}, lambda job, said: states.append((job.state, *said)))
    end = time.monotonic() + PATIENCE
    while not job.over and time.monotonic() < end:
        time.sleep(0.05)
    jobs.close()
    assert (states, job.state) == ([("running", "failed")], FAILED)


def test_a_job_that_cannot_begin_fails_and_the_next_one_begins(monkeypatch):
    """Too many open files, for a moment: the job was "running" for ever, and all others waited for it."""
    jobs, told = Jobs(1), []
    worker = jobs_module.worker

    def refused(out):
        raise OSError(24, "Too many open files")

    monkeypatch.setattr(jobs_module, "worker", refused)
    first = jobs.submit("x", {"task": "nothing"}, lambda job, said: told.append(said))
    assert (first.state, list(told[0])) == (FAILED, ["failed"])
    assert first.error == "the job cannot begin (Too many open files); end others, and try again"
    monkeypatch.setattr(jobs_module, "worker", worker)
    second = jobs.submit("x", {"task": "nothing"}, lambda job, said: told.append(said))
    assert second.state != WAITING
    jobs.close()
