"""Where programs keep what they can make again: compiled kernels, packings, measured rates.

Compiled kernels are executed, so they lie in a folder that only this user and root can change, or put another in the
place of. Every folder on the way is opened relative to the one before and checked when it is open, as sshd does with
the keys of users; files are opened relative to the last one. Nothing can be exchanged between check and use.
"""

import errno
import fcntl
import functools
import hashlib
import logging
import os
import stat
import weakref
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

log = logging.getLogger("hpcpic.cache")

_FOLDER = os.O_PATH | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC
_FILE = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC  # nothing to wait for in a pipe of that name
_DRAFT = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
_SHARED = stat.S_IWGRP | stat.S_IWOTH
_LINKS = 40  # on the way to a folder; more are a loop
_DIGEST = 32  # bytes of SHA-256


def cache_root() -> Path:
    """$HPCPIC_CACHE_DIR, else $XDG_CACHE_HOME/hpcpic, else ~/.cache/hpcpic. OSError for a user without a home."""
    asked = os.environ.get("HPCPIC_CACHE_DIR")
    caches = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    if not asked and caches.startswith("~"):  # it stays where there is no home
        raise FileNotFoundError(errno.ENOENT, "there is no home folder", "~/.cache")
    return Path(asked or Path(caches) / "hpcpic")


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Errors of calls that know a file by its name in an open folder tell its whole path."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None


def _refusal(path: Path, why: str) -> PermissionError:
    return PermissionError(errno.EACCES, why, str(path))


def _require_owner(path: Path, status: os.stat_result, owners: set[int]) -> None:
    if status.st_uid not in owners:
        raise _refusal(path, f"belongs to another user (number {status.st_uid})")


def _require_unshared(path: Path, status: os.stat_result) -> None:
    if status.st_mode & _SHARED:
        raise _refusal(path, f"can be written by others (mode {stat.S_IMODE(status.st_mode):o})")


def _require_own(path: Path, status: os.stat_result) -> None:
    _require_owner(path, status, {os.getuid()})
    _require_unshared(path, status)


class _Way:
    """Open folders from "/" on, each checked: owned by this user or root, and written by nobody else, or sticky."""

    def __init__(self) -> None:
        self.path = Path("/")
        self._open = [os.open("/", _FOLDER)]

    def go(self, path: Path) -> int:
        """Descriptor of the folder; what is missing of it is made, for this user alone. Raises OSError."""
        links, left = 0, list(path.absolute().parts[:0:-1])
        try:
            while left:
                name = left.pop()
                if name == "..":
                    self._back(max(1, len(self._open) - 1))
                elif name not in ("", "."):
                    target = self._enter(name)
                    links += bool(target)
                    if links > _LINKS:
                        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path))
                    if target.startswith("/"):
                        self._back(1)
                    left += target.split("/")[::-1]
            return os.dup(self._open[-1])
        finally:
            self._back(0)

    def _back(self, depth: int) -> None:
        while len(self._open) > depth:
            os.close(self._open.pop())
            self.path = self.path.parent

    def _enter(self, name: str) -> str:
        """Go into a folder; "" then. Of a link its target."""
        here, path = self._open[-1], self.path / name
        owners = self._owners()
        with _naming(path):
            try:
                status = os.stat(name, dir_fd=here, follow_symlinks=False)
            except FileNotFoundError:
                with suppress(FileExistsError):
                    os.mkdir(name, 0o700, dir_fd=here)
                status = os.stat(name, dir_fd=here, follow_symlinks=False)
            if stat.S_ISLNK(status.st_mode):
                _require_owner(path, status, owners)
                return os.readlink(name, dir_fd=here)
            self._open.append(os.open(name, _FOLDER, dir_fd=here))
            self.path = path
            _require_owner(path, os.fstat(self._open[-1]), owners)
            return ""

    def _owners(self) -> set[int]:
        """Who may own what is in this folder. Where others make files of their own, not the owner of "/": that is root,
        but in a user namespace without root it is everybody else, too.
        """
        here, root = (os.fstat(descriptor) for descriptor in (self._open[-1], self._open[0]))
        if not here.st_mode & _SHARED:
            return {0, os.getuid(), root.st_uid}
        if not here.st_mode & stat.S_ISVTX:
            _require_unshared(self.path, here)
        return {0, os.getuid()}


class Folder:
    """A folder that nobody but this user and root can change or replace, held open. Raises OSError."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._descriptor = _Way().go(path)
        weakref.finalize(self, os.close, self._descriptor)
        _require_own(path, os.fstat(self._descriptor))

    def read(self, name: str) -> bytes:
        path = self.path / name
        with _naming(path), os.fdopen(os.open(name, _FILE, dir_fd=self._descriptor), "rb") as file:
            status = os.fstat(file.fileno())
            if not stat.S_ISREG(status.st_mode):
                raise _refusal(path, "is not a plain file")
            _require_own(path, status)
            return file.read()

    def write(self, name: str, content: bytes) -> None:
        """The file appears complete or not at all. (After a loss of power it may be cut: it is not waited for.)"""
        draft = f".{name[:64]}.{os.urandom(8).hex()}.tmp"
        with _naming(self.path / name):
            try:
                with os.fdopen(os.open(draft, _DRAFT, 0o600, dir_fd=self._descriptor), "wb") as file:
                    file.write(content)
                os.replace(draft, name, src_dir_fd=self._descriptor, dst_dir_fd=self._descriptor)
            except BaseException:
                with suppress(OSError):
                    os.unlink(draft, dir_fd=self._descriptor)
                raise

    def has(self, name: str) -> bool:
        try:
            os.stat(name, dir_fd=self._descriptor, follow_symlinks=False)
        except OSError:
            return False
        return True

    def remove(self, name: str) -> None:
        with _naming(self.path / name):
            os.unlink(name, dir_fd=self._descriptor)


def private_path(*names: str) -> Path:
    """<cache root>/<number of the user>/names. Raises OSError."""
    return cache_root().joinpath(str(os.getuid()), *names)


def private_folder(*names: str) -> Folder:
    """That folder, made where it is missing. Raises OSError."""
    return Folder(private_path(*names))


class Store:
    """Files that can be made again, in a private folder. Each holds its own hash, and a damaged one counts as missing.
    Where the folder cannot be used no file is kept. The log warns once for each reason.
    """

    def __init__(self, what: str, *names: str) -> None:
        self.what = what
        self.folder: Folder | None = None
        self._written = True  # until the disk is full
        try:
            self.folder = private_folder(*names)
        except OSError as error:
            self._not_kept(error)

    def read(self, name: str) -> bytes | None:
        """The content that was written last under this name."""
        if self.folder is None:
            return None
        try:
            content = self.folder.read(name)
        except FileNotFoundError:
            return None
        except OSError as error:
            self.damaged(str(error.strerror))
            return None
        if len(content) < _DIGEST or hashlib.sha256(content[_DIGEST:]).digest() != content[:_DIGEST]:
            self.damaged("other bytes than were written")
            return None
        return content[_DIGEST:]

    @property
    def keeps(self) -> bool:
        """Whether files can be kept, as far as is known."""
        return self.folder is not None and self._written

    def has(self, name: str) -> bool:
        """Whether there is a file of this name, sound or not."""
        return self.folder is not None and self.folder.has(name)

    def write(self, name: str, content: bytes) -> None:
        if self.folder is None:
            return
        try:
            self.folder.write(name, hashlib.sha256(content).digest() + content)
        except OSError as error:
            self._written = False
            self._not_kept(error)

    def claim(self, name: str) -> bool:
        """Whether this process may make the file now: no other one is at it. True where processes cannot tell.

        A claim ends with `release` or with the process, however that ends.
        """
        return self._lock(name, fcntl.LOCK_EX | fcntl.LOCK_NB)

    def release(self, name: str) -> None:
        self._lock(name, fcntl.LOCK_UN)

    def _lock(self, name: str, what: int) -> bool:
        locks = _locks(self.folder.path.parent) if self.folder and self.keeps else None
        if self.folder is None or locks is None:
            return True
        place = int.from_bytes(hashlib.sha256(f"{self.folder.path} {name}".encode()).digest()[:6], "little")
        try:
            fcntl.lockf(locks, what, 1, place)  # a byte of the file for each name
        except (BlockingIOError, PermissionError):
            return False
        except OSError:  # a file system without locks
            pass
        return True

    def damaged(self, how: str) -> None:
        """A file here is of no use; whoever asked makes it anew."""
        assert self.folder is not None
        _warn_once(self.what, how, f"{self.what}: damaged files in {self.folder.path} ({how}): made anew")

    def _not_kept(self, error: OSError) -> None:
        where = f"{error.filename}: {error.strerror}"
        text = f"{self.what} not kept, and made anew in every run: {where} (HPCPIC_CACHE_DIR names another folder)"
        _warn_once(self.what, str(error.strerror), text)


@functools.cache
def _locks(folder: Path) -> int | None:
    """A file whose bytes processes lock, open for good: whoever closes it loses all that it has locked."""
    try:
        return os.open(folder / "claims", os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    except OSError:
        return None


_warned: set[tuple[str, str]] = set()  # of which files, and why


def _warn_once(what: str, reason: str, text: str) -> None:
    """However many files it is about."""
    if (what, reason) not in _warned:
        _warned.add((what, reason))
        log.warning(text)
