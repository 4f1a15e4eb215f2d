#!/usr/bin/env -S python3 -B
"""tidy.py checks what has changed and nothing else. Usage: tidy_test.py

Each test has a small project with a copy of tidy.py and a cache folder of its own."""
import json
import os
import re
import shutil
import subprocess
import tempfile
import time
import unittest
from pathlib import Path

from tidy import judge

HERE = Path(__file__).resolve().parent
CONFIGURATION = "Checks: '-*,bugprone-integer-division,bugprone-infinite-loop'\nWarningsAsErrors: '*'\n"
FILES = {
    ".clang-tidy": CONFIGURATION,
    "common/size.hpp": "#pragma once\ninline int size() { return 1; }\n",
    "common/user.hpp": '#pragma once\n#include "common/size.hpp"\n',
    "common/first.cpp": '#include "common/user.hpp"\n#include <system.hpp>\nint number() { return size(); }\n',
    # Cannot stand beside first.cpp: a function of the same name.
    "common/second.cpp": "double number() { return 0.0; }\n",
    "common/third.cpp": "int other() { return 0; }\n",
}
FINDING = "double half(int a) { return a / 2 + 0.5; }\n"
FINDING_OF_FLOW = "void wait(int i) {\n  while (i < 2) {\n  }\n}\n"


class Project:
    def __init__(self, folder, system):
        self.folder, self.system = folder, system
        for name in ("tidy.py", "tidy_cache.py"):
            # All sources in one file, however many processors there are.
            self.write(f"tests/lint/{name}", (HERE / name).read_text().replace("os.cpu_count()", "1"))
            (folder / "tests/lint" / name).chmod(0o755)
        for name, text in FILES.items():
            self.write(name, text)
        self.compile_with()

    def write(self, name, text):
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)

    def compile_with(self, *options):
        build = self.folder / "build"
        command = ["env", "CCACHE_NOHASHDIR=yes", "/usr/bin/ccache", "/usr/bin/c++", *options, f"-I{self.folder}",
                   "-isystem", str(self.system), "-O2", "--param=min-pagesize=0", "-Wall", "-Winvalid-pch", "-include",
                   f"{build}/cmake_pch.hxx", "-std=c++20", "-MD", "-MF", "x.d", "-o", "x.o", "-c", "common_0.cpp"]
        batch = {"directory": str(build), "file": f"{build}/common/common_0.cpp", "command": " ".join(command)}
        self.write("build/compile_commands.json", json.dumps([batch]))


class TidyTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name).resolve()
        self.cache = self.folder / "cache/tether/tidy"
        self.system = self.folder / "system"
        self.system.mkdir()
        (self.system / "system.hpp").write_text("#pragma once\n")
        self.project = Project(self.folder / "one", self.system)

    def tidy(self, *options, project=None):
        """The exit code, and what is printed."""
        project = project or self.project
        result = subprocess.run(
            [project.folder / "tests/lint/tidy.py", *options, project.folder / "build", "common"],
            env={**os.environ, "XDG_CACHE_HOME": str(self.folder / "cache")},
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        return result.returncode, result.stdout

    def checked(self, *options, project=None):
        """How many of the sources, which are clean, are checked now."""
        code, output = self.tidy(*options, project=project)
        self.assertEqual(code, 0, output)
        return int(re.search(r"(\d+) checked now", output)[1])

    def test_an_unchanged_source_is_not_checked_again(self):
        self.assertEqual(self.checked(), 3)
        self.assertEqual(self.checked(), 0)
        self.assertEqual(self.checked("--no-cache"), 3)

    def test_another_folder_uses_the_results_of_the_first(self):
        self.assertEqual(self.checked(), 3)
        self.assertEqual(self.checked(project=Project(self.folder / "elsewhere/two", self.system)), 0)

    def test_a_change_is_checked_where_it_is_seen(self):
        self.assertEqual(self.checked(), 3)
        self.project.write("common/third.cpp", "int other() { return 1; }\n")
        self.assertEqual(self.checked(), 1, "a source")
        self.project.write("common/size.hpp", "#pragma once\ninline int size() { return 2; }\n")
        self.assertEqual(self.checked(), 1, "a header that another header includes")
        (self.system / "system.hpp").write_text("#pragma once\n#define SYSTEM 2\n")
        self.assertIn(self.checked(), (1, 2), "a system header, of a source and others checked with it")
        self.project.compile_with("-DNAME=1")
        self.assertEqual(self.checked(), 3, "an option")
        self.project.write(".clang-tidy", CONFIGURATION + "FormatStyle: none\n")
        self.assertEqual(self.checked(), 3, "the configuration")
        self.assertEqual(self.checked(), 0)

    def test_a_finding_is_reported_each_time(self):
        self.project.write("common/third.cpp", FINDING)
        for _ in range(2):
            code, output = self.tidy()
            self.assertEqual(code, 1)
            self.assertIn("common/third.cpp:1:29: error:", output)
        self.assertIn("1 of 3 sources", output)

    def test_a_finding_in_a_header_is_of_all_sources_that_include_it(self):
        self.project.write("common/size.hpp", "#pragma once\ninline int size() { return 1; }\ninline " + FINDING)
        self.project.write("common/third.cpp", '#include "common/size.hpp"\n')
        for _ in range(2):
            code, output = self.tidy()
            self.assertEqual(code, 1)
            self.assertEqual(output.count("common/size.hpp:3:"), 1, output)
            self.assertIn("2 of 3 sources", output)

    def test_a_finding_behind_a_source_that_does_not_fit_is_reported(self):
        self.project.write("common/second.cpp", FILES["common/second.cpp"] + FINDING)
        self.project.write("common/third.cpp", FINDING.replace("half", "third") + FINDING_OF_FLOW)
        code, output = self.tidy()
        self.assertEqual(code, 1)
        for place in ("second.cpp:2:29", "third.cpp:1:30", "third.cpp:3:3"):
            self.assertEqual(output.count(f"common/{place}: error:"), 1, output)
        self.assertNotIn("clang-diagnostic", output)

    def test_an_error_in_a_system_header_is_of_the_source_that_it_names(self):
        output = ("/usr/include/c++/12/bits/algobase.h:7:8: error: no matching function for call to object of type "
                  "'Iter<(lambda at /p/b.cpp:37:54)>' [clang-diagnostic-error]\n        if (pred(first))\n")
        found, clean, again = judge(output, True, ["/p/a.cpp", "/p/b.cpp", "/p/c.cpp"], lambda source, file: False)
        self.assertEqual((found, clean, again), ([], ["/p/a.cpp", "/p/c.cpp"], ["/p/b.cpp"]))

    def test_a_source_that_does_not_compile_is_an_error(self):
        for text in ("int wrong( { }\n", '#include "common/missing.hpp"\n'):
            self.project.write("common/first.cpp", text)
            for _ in range(2):
                code, output = self.tidy()
                self.assertEqual(code, 1)
                self.assertIn("common/first.cpp:1:", output)

    def test_what_is_not_used_for_30_days_is_removed(self):
        self.assertEqual(self.checked(), 3)
        kept = set(self.cache.iterdir())
        for age_days, removed in ((29, False), (31, True)):
            old = self.cache / "0123"
            old.write_text("")
            os.utime(old, (time.time() - age_days * 86400,) * 2)
            self.assertEqual(self.checked(), 0)
            self.assertEqual(not old.exists(), removed)
        self.assertLessEqual(kept, set(self.cache.iterdir()))

    def test_runs_at_the_same_time_do_not_harm_each_other(self):
        command = [self.project.folder / "tests/lint/tidy.py", self.project.folder / "build", "common"]
        environment = {**os.environ, "XDG_CACHE_HOME": str(self.folder / "cache")}
        runs = [subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL) for _ in range(3)]
        self.assertEqual([run.wait() for run in runs], [0, 0, 0])
        self.assertEqual(self.checked(), 0)
        self.assertEqual([path.name for path in self.cache.iterdir() if path.name.startswith("tmp")], [])


if __name__ == "__main__":
    if not shutil.which("clang-tidy"):
        raise SystemExit("clang-tidy is missing: apt install clang-tidy")
    unittest.main()
