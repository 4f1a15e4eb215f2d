"""fixed_jar.py FILE: rewrites a Java archive so that the same classes give the same bytes: no times, entries sorted, the
manifest first."""

import sys
import zipfile


def main(path):
    with zipfile.ZipFile(path) as jar:
        entries = {name: jar.read(name) for name in jar.namelist()}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as jar:
        for name in sorted(entries, key=lambda name: (not name.startswith("META-INF/"), name)):
            entry = zipfile.ZipInfo(name)  # a date of 1980
            entry.compress_type = zipfile.ZIP_DEFLATED
            jar.writestr(entry, entries[name])


main(sys.argv[1])
