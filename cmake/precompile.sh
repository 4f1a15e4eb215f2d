#!/bin/sh
# precompile.sh COMPILER ARGUMENTS...: compiles, and leaves beside a precompiled header NAME the file NAME.sum:
# a checksum of all files that it was made of, by which ccache knows it (pch_external_checksum).
set -eu
"$@"
out= previous=
for word; do
    [ "$previous" != -o ] || out=$word
    previous=$word
done
case $out in
    *.gch | *.pch)
        sed 's/^[^:]*://; s/\\$//' "$out.d" | tr -s ' ' '\n' | sed '/^$/d' | sort -u | xargs sha256sum |
            cut -c1-64 | sort | sha256sum >"$out.sum"
        ;;
esac
