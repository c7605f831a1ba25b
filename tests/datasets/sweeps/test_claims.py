"""Claims of work: one parent has a bucket, whoever else asks; a dead parent's are taken over; on S3 as on a disk."""

import os
import platform
import subprocess
import sys

import pytest
from s3_server import s3_bucket

from palpate.datasets.errors import SweepStoreError
from palpate.datasets.sweeps.claims import Claims, LocalPlace, SharedPlace, is_dead_process


class Clock:
    def __init__(self):
        self.now = 0.0

    def __call__(self):
        return self.now


@pytest.fixture(scope="module")
def bucket():
    """A bucket of an S3 server of this machine."""
    with pytest.MonkeyPatch.context() as patch, s3_bucket(patch) as url:
        yield url


@pytest.fixture(params=["folder", "file://", pytest.param("s3", marks=pytest.mark.exhaustive)])
def place(request, tmp_path):
    if request.param == "folder":
        return LocalPlace(tmp_path)
    if request.param == "s3":
        return SharedPlace(f"{request.getfixturevalue('bucket')}/{tmp_path.name}")
    return SharedPlace(f"file://{tmp_path}/shared")


def test_a_place_creates_exclusively_and_reads_what_was_written(place):
    assert place.create("claims/a.1", "one")
    assert not place.create("claims/a.1", "two")
    assert place.read("claims/a.1") == "one"
    place.write("claims/a.1", "three")
    assert place.read("claims/a.1") == "three"
    assert place.read("claims/b.1") is None
    assert place.create("claims/ab.1", "")
    assert sorted(place.names("claims")) == ["a.1", "ab.1"]
    assert place.names("claims", "a.") == ["a.1"]
    assert place.names("nothing") == []
    place.remove("claims/a.1")
    place.remove("claims/a.1")
    assert place.names("claims") == ["ab.1"]


def test_one_parent_has_a_bucket_until_it_ends(place):
    one, other = Claims(place), Claims(place)
    assert one.take("a")
    assert one.take("a")
    assert not other.take("a")
    assert other.take("b")
    one.release()
    assert other.take("a")


def test_a_parent_without_a_sign_of_life_loses_its_claims_after_the_lease(place):
    clock = Clock()
    one, other = Claims(place, lease=60.0, clock=clock), Claims(place, lease=60.0, clock=clock)
    assert one.take("a")
    for _ in range(10):
        clock.now += 20.0
        one.renew()
        assert not other.take("a")
    clock.now += 59.0
    assert not other.take("a")
    clock.now += 2.0
    assert other.take("a")
    assert not one.take("a") or one.take("a")  # it may go on: what both make counts once
    third = Claims(place, lease=60.0, clock=clock)
    assert not third.take("a")


DIE = """
import os, sys
from pathlib import Path
from palpate.datasets.sweeps.claims import Claims, LocalPlace
print(Claims(LocalPlace(Path(sys.argv[1]))).take("a"), flush=True)
os._exit(9)
"""


def test_a_claim_whose_owner_died_on_this_host_is_taken_over_at_once(tmp_path):
    done = subprocess.run([sys.executable, "-c", DIE, tmp_path], stdout=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stdout) == (9, "True\n")
    (name,) = LocalPlace(tmp_path).names("parents")
    assert is_dead_process(name)
    assert Claims(LocalPlace(tmp_path)).take("a")


def test_what_a_parent_killed_on_this_host_left_goes_with_the_next_one_that_ends(tmp_path):
    place = LocalPlace(tmp_path)
    ended = subprocess.run(["sh", "-c", "echo $$"], capture_output=True, text=True).stdout.strip()
    killed = f"{platform.node()}-{ended}-0a"
    for owner, claim in ((killed, "a.1"), ("elsewhere-7-0b", "b.1"), ("", "c.1")):
        place.create(f"claims/{claim}", owner)
        if owner:
            place.write(f"parents/{owner}", "1")
    parent = Claims(place)
    assert parent.take("d")
    parent.release()
    assert place.names("parents") == ["elsewhere-7-0b"]
    assert sorted(place.names("claims")) == ["b.1", "c.1"]


MANY = """
import sys
from pathlib import Path
from palpate.datasets.sweeps.claims import Claims, LocalPlace
claims = Claims(LocalPlace(Path(sys.argv[1])))
print(*[bucket for bucket in map(str, range(300)) if claims.take(bucket)], flush=True)
sys.stdin.read()
"""


@pytest.mark.exhaustive
def test_processes_that_claim_at_once_share_without_overlap(tmp_path):
    words = [sys.executable, "-c", MANY, str(tmp_path)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    processes = [subprocess.Popen(words, text=True, **pipes) for _ in range(4)]
    taken = [process.stdout.readline().split() for process in processes]
    for process in processes:
        process.communicate()
    assert sorted(bucket for own in taken for bucket in own) == sorted(map(str, range(300)))


def test_files_are_shared_whole(place, tmp_path):
    if isinstance(place, LocalPlace):
        pytest.skip("parents of one store share its files")
    (tmp_path / "own").write_bytes(b"x" * 100_000)
    place.put(tmp_path / "own", "shards/a.h5")
    assert place.names("shards") == ["a.h5"]
    place.get("shards/a.h5", tmp_path / "other")
    assert (tmp_path / "other").read_bytes() == b"x" * 100_000


def test_a_place_that_cannot_be_is_refused(monkeypatch):
    with pytest.raises(SweepStoreError, match="nosuch://x: no file system for it is installed"):
        SharedPlace("nosuch://x")
    monkeypatch.setitem(sys.modules, "fsspec", None)
    with pytest.raises(SweepStoreError, match=r"pip install -e '.\[share\]'"):
        SharedPlace("s3://x/y")


def test_a_place_where_nothing_can_be_created_is_refused():
    for url in ("nonsense", "shared/study", "http://host/x", "https://host/x", "zip://x", "nothing://x"):
        with pytest.raises(SweepStoreError, match=url):
            SharedPlace(url)


@pytest.mark.parametrize(
    "damage",
    [
        lambda path: os.mkfifo(path),
        lambda path: path.mkdir(),
        lambda path: path.symlink_to("/dev/zero"),
        lambda path: path.write_text("../pipe"),
        lambda path: path.write_bytes(b"\377\376\0"),
        lambda path: path.write_bytes(b"x" * 10**6),
        lambda path: path.write_text(f"{os.uname().nodename}-99999999999999999999-ab"),
    ],
    ids=["pipe", "folder", "link", "path", "bytes", "large", "number"],
)
def test_a_claim_that_no_parent_wrote_keeps_nobody_from_the_work(tmp_path, damage):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "claims").mkdir()
    damage(tmp_path / "claims/a.1")
    clock = Clock()
    claims = Claims(LocalPlace(tmp_path), lease=60.0, clock=clock)
    is_taken = claims.take("a")
    clock.now += 61.0
    assert is_taken or claims.take("a")
    assert is_dead_process(f"{os.uname().nodename}-99999999999999999999-ab")
