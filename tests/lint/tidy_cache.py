"""Which sources clang-tidy has found clean, like ccache's direct mode: see Cache."""
import contextlib
import hashlib
import os
import re
import tempfile
import time
from pathlib import Path

FORMAT = "1"  # format of the stored data: another one, another cache
KEPT_S = 30 * 24 * 3600.0
INCLUDE = re.compile(r"^[ \t]*#[ \t]*(?:include|include_next|import)\b[ \t]*(.*)$", re.MULTILINE)
NAME = re.compile(r'"([^"\n]+)"|<([^>\n]+)>')


def digest(data):
    return hashlib.sha256(data).hexdigest()


class Sources:
    """The project's files that each source includes, found by reading #include lines. Every such line
    counts, whatever #if is around it. Files of the project are those below the checkout or the build folder.
    """

    def __init__(self, root, build, options):
        self.root, self.build, self.options = str(root), str(build), options
        self.quoted, self.angled = [], []
        for option, value in zip(options, [*options[1:], ""]):
            if option == "-iquote":
                self.quoted.append(value)
            elif option in ("-I", "-isystem", "-idirafter"):
                self.angled.append(value)
            elif option.startswith("-I"):
                self.angled.append(option[2:])
        self.folders = [folder for folder in self.angled if self.is_project(folder + "/")]
        self.quoted = [folder for folder in self.quoted if self.is_project(folder + "/")]
        self.digests, self.direct, self.all, self.exists = {}, {}, {}, {}
        self.unreadable = set()  # files with an #include of a macro

    def is_project(self, path):
        return path.startswith((self.build + "/", self.root + "/"))

    def portable(self, text):
        """The text as another clone in another folder has it."""
        return text.replace(self.build, "BUILD").replace(self.root, "ROOT")

    def is_file(self, path):
        if path not in self.exists:
            self.exists[path] = os.path.isfile(path)
        return self.exists[path]

    def included(self, path):
        """The project's files that the file includes itself."""
        if path not in self.direct:
            data = Path(path).read_bytes()
            self.digests[path] = digest(data)
            found = []
            for line in INCLUDE.findall(data.decode(errors="replace")):
                match = NAME.match(line)
                if not match:
                    self.unreadable.add(path)
                    continue
                folders = [os.path.dirname(path), *self.quoted] if match[1] else []
                candidates = (os.path.normpath(os.path.join(folder, match[1] or match[2]))
                              for folder in folders + self.folders)
                found += [next(filter(self.is_file, candidates), None)]
            self.direct[path] = [file for file in found if file]
        return self.direct[path]

    def closure(self, source):
        """The source and all of the project's files that it includes, directly or not."""
        if source not in self.all:
            seen, rest = {source}, [source]
            while rest:
                new = set(self.included(rest.pop())) - seen
                seen |= new
                rest += new
            self.all[source] = frozenset(seen)
        return self.all[source]

    def is_unchanged(self, source):
        """Whether the source and what it includes are as they were when they were read first."""
        return all(digest(Path(file).read_bytes()) == self.digests[file] for file in self.closure(source))

    def includes(self, source, file):
        return file in self.closure(source)

    def key(self, source, common):
        """Names the result of checking the source: equal for equal names, contents and `common` (tool,
        configuration, options). None if the files that it includes cannot be known."""
        files = self.closure(source)
        if files & self.unreadable:
            return None
        lines = [FORMAT, common, self.portable(source)]
        lines += sorted(f"{self.portable(file)} {self.digests[file]}" for file in files)
        return digest("\n".join(lines).encode())


class Cache:
    """Clean results in a folder that several runs may use at the same time.

    A file `KEY` (Sources.key) says that this source was found clean. It contains the name of a file
    `DIGEST.headers`, which lists the system headers of that check and the digests of their contents. The
    result holds while all of these have the same contents. Without a folder nothing is stored or found, and a
    folder that cannot be written fails no check.
    """

    def __init__(self, folder):
        self.folder = folder
        self.digests, self.holding = {}, {}
        try:
            if folder:
                folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            print(f"results are not kept: {error}")
            self.folder = None

    @staticmethod
    def default_folder():
        base = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
        return Path(base).expanduser() / "tether" / "tidy"

    def is_clean(self, key):
        if not self.folder or not key:
            return False
        try:
            name = (self.folder / key).read_text()
            if not self.holds(name):
                return False
            self.use(self.folder / key)
        except OSError:  # never stored, or removed by another run
            return False
        return True

    def store(self, keys, headers):
        """Stores that the sources of these keys are clean with these system headers."""
        if not self.folder:
            return
        text = "".join(f"{self.digest_of(header)} {header}\n" for header in sorted(headers))
        name = digest(text.encode()) + ".headers"
        with contextlib.suppress(OSError):  # a full disk
            self.write(name, text)
            for key in filter(None, keys):
                self.write(key, name)

    def remove_old(self, now):
        if not self.folder:
            return
        for path in self.folder.iterdir():
            try:
                if now - path.stat().st_mtime > KEPT_S:
                    path.unlink()
            except OSError:  # removed by another run
                pass

    def holds(self, name):
        """Whether the system headers that the file lists have the contents that they had."""
        if name not in self.holding:
            path = self.folder / name
            lines = [line.split(" ", 1) for line in path.read_text().splitlines()]
            self.holding[name] = all(self.digest_of(header) == known for known, header in lines)
            self.use(path)
        return self.holding[name]

    def digest_of(self, header):
        if header not in self.digests:
            try:
                self.digests[header] = digest(Path(header).read_bytes())
            except OSError:
                self.digests[header] = "missing"
        return self.digests[header]

    def write(self, name, text):
        """Writes the file at once: another run sees all of it or nothing."""
        with tempfile.NamedTemporaryFile("w", dir=self.folder, delete=False) as file:
            file.write(text)
        os.replace(file.name, self.folder / name)

    @staticmethod
    def use(path):
        """Marks the file as used; once per day is often enough."""
        if time.time() - path.stat().st_mtime > 24 * 3600:
            os.utime(path)
