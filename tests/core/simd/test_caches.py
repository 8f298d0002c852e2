"""What is kept for later is read only where nobody else can have written it."""

import os
import stat

import pytest

from hpcpic.core.app.rates import keep_rates, read_rates
from hpcpic.core.errors import FileError
from hpcpic.core.simd import caches
from hpcpic.core.simd.caches import Store, private_folder

STRANGER = 12345
as_root = pytest.mark.skipif(os.getuid() != 0, reason="only root can give a folder away")


@pytest.fixture
def root(monkeypatch, tmp_path):
    """The cache root, two folders below one that only we can change."""
    tmp_path.chmod(0o755)
    root = tmp_path / "scratch" / "root"
    monkeypatch.setenv("HPCPIC_CACHE_DIR", str(root))
    caches._warned.clear()
    return root


def levels(root):
    """Every folder of ours on the way to a file that is kept."""
    private_folder("kernels")
    return [root.parent, root, root / str(os.getuid()), root / str(os.getuid()) / "kernels"]


def test_folders_are_made_for_us_alone_whatever_the_umask(root):
    before = os.umask(0)
    try:
        folder = private_folder("kernels")
        folder.write("a", b"1")
    finally:
        os.umask(before)
    modes = [stat.S_IMODE(path.stat().st_mode) for path in (*levels(root), folder.path / "a")]
    assert modes == [0o700] * 4 + [0o600]
    assert folder.path == root / str(os.getuid()) / "kernels"


def test_the_default_root_is_the_users_cache(monkeypatch, tmp_path):
    monkeypatch.delenv("HPCPIC_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert private_folder().path.is_relative_to(tmp_path / "hpcpic")


def test_a_user_without_a_home_keeps_nothing_and_is_told(monkeypatch, caplog):
    for name in ("HPCPIC_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)  # what it does where the system knows of no home
    caches._warned.clear()
    for _ in range(2):
        store = Store("compiled code")
        store.write("a", b"1")
        assert store.read("a") is None
    (record,) = caplog.records
    assert "no home folder" in record.message and "HPCPIC_CACHE_DIR" in record.message
    assert read_rates() == {}
    with pytest.raises(FileError, match="no home folder"):
        keep_rates({"update": 1.0})


@pytest.mark.parametrize("mode", [0o770, 0o702, 0o757])
@pytest.mark.parametrize("level", range(4))
def test_no_folder_on_the_way_may_be_written_by_others(root, caplog, level, mode):
    folder = levels(root)[level]
    folder.chmod(mode)
    with pytest.raises(PermissionError, match="can be written by others") as refused:
        private_folder("kernels")
    assert refused.value.filename == str(folder)
    store = Store("compiled code", "kernels")
    store.write("a", b"1")
    assert store.read("a") is None and str(folder) in caplog.text
    assert not list(root.rglob("a"))


@as_root
@pytest.mark.parametrize("level", range(4))
def test_no_folder_on_the_way_may_belong_to_another_user(root, level):
    folder = levels(root)[level]
    os.chown(folder, STRANGER, STRANGER)
    with pytest.raises(PermissionError, match=f"another user .number {STRANGER}"):
        private_folder("kernels")


@pytest.mark.parametrize("level", range(2))
def test_others_may_have_folders_beside_ours_where_only_owners_rename(root, level):
    """As on a scratch that all write to: nobody else can put something in the place of what is ours."""
    levels(root)[level].chmod(0o1777)
    private_folder("kernels").write("a", b"1")


@as_root
@pytest.mark.parametrize("below", ["", "hpcpic"])
def test_what_another_user_made_first_in_a_shared_folder_is_refused(root, below):
    """A folder, or a link to one that is ours: it can be exchanged at any time."""
    root.parent.mkdir()
    root.parent.chmod(0o1777)
    if below:
        root.mkdir()
        os.chown(root, STRANGER, STRANGER)
    else:
        (root.parent / "elsewhere").mkdir(mode=0o700)
        root.symlink_to("elsewhere")
        os.lchown(root, STRANGER, STRANGER)
    with pytest.raises(PermissionError, match="another user"):
        private_folder("kernels")


def test_links_are_followed_where_only_we_can_make_them(root, tmp_path):
    """A home on another disk is often one."""
    (tmp_path / "disk/cache").mkdir(parents=True)
    root.parent.symlink_to("disk/../disk/./cache")
    private_folder("kernels").write("a", b"1")
    assert (tmp_path / "disk/cache/root").is_dir()
    (tmp_path / "disk").chmod(0o777)
    with pytest.raises(PermissionError, match="written by others"):
        private_folder("kernels")


def test_links_in_a_circle_end(root):
    root.parent.symlink_to(root.parent.name)
    with pytest.raises(OSError, match="symbolic links"):
        private_folder()


def test_a_folder_that_is_exchanged_after_the_check_is_not_looked_into(root):
    store = Store("compiled code", "kernels")
    store.write("a", b"ours")
    path = store.folder.path
    path.rename(path.with_name("away"))
    path.mkdir()
    (path / "a").write_bytes(b"theirs")
    assert store.read("a") == b"ours"
    store.write("b", b"ours")
    assert os.listdir(path) == ["a"]


def test_only_plain_files_of_ours_are_read(root, tmp_path, caplog):
    store = Store("compiled code", "kernels")
    store.write("a", b"ours")
    path = store.folder.path / "a"
    kept = path.rename(tmp_path / "kept")
    for put in (os.mkfifo, os.mkdir, lambda place: place.symlink_to(kept)):
        put(path)
        assert store.read("a") is None
        path.rmdir() if path.is_dir() else path.unlink()
    kept.rename(path)
    assert store.read("a") == b"ours"
    path.chmod(0o620)
    assert store.read("a") is None
    path.chmod(0o600)
    if os.getuid() == 0:
        os.chown(path, STRANGER, STRANGER)
        assert store.read("a") is None
    store.write("a", b"anew")
    assert store.read("a") == b"anew"


def test_descriptors_on_the_way_are_closed(root):
    store = Store("compiled code", "kernels")
    before = len(os.listdir("/proc/self/fd"))
    for _ in range(3):
        store.write("a", b"1")
        store.read("a"), store.read("b"), private_folder("kernels")
    root.chmod(0o777)
    for _ in range(3):
        with pytest.raises(PermissionError):
            private_folder("kernels")
    assert len(os.listdir("/proc/self/fd")) == before


def test_many_files_that_are_damaged_or_not_kept_cost_one_warning_each(root, monkeypatch, caplog):
    stores = [Store("compiled code", program) for program in ("one", "two")]
    for store in stores:
        for name in "ab":
            store.write(name, b"1")
            (store.folder.path / name).write_bytes(b"")
            assert store.read(name) is None

    def full(name, content):
        raise OSError(28, "No space left on device", name)

    for store in stores:
        monkeypatch.setattr(store.folder, "write", full)
        store.write("a", b"1")
        store.write("b", b"1")
    assert ["damaged" in record.message for record in caplog.records] == [True, False]


def test_a_file_with_a_flipped_bit_is_not_there(root):
    store = Store("things", "here")
    store.write("a", b"content")
    path = store.folder.path / "a"
    sound = path.read_bytes()
    assert store.read("a") == b"content"
    for place in range(len(sound)):
        path.write_bytes(sound[:place] + bytes([sound[place] ^ 1]) + sound[place + 1 :])
        assert store.read("a") is None
