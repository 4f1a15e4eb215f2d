"""fixed_deb.py FILE...: sets the modes of a Debian package's three members, which the builder's umask decides, to 0644."""

import sys

HEADER = 60  # bytes of an ar(5) header: name 16, time 12, user 6, group 6, mode 8, size 10, end 2


def main(paths):
    for path in paths:
        with open(path, "r+b") as package:
            place = len(package.read(8))
            while header := package.read(HEADER):
                package.seek(place + 40)
                package.write(b"100644  ")
                size = int(header[48:58])
                place += HEADER + size + size % 2
                package.seek(place)


main(sys.argv[1:])
