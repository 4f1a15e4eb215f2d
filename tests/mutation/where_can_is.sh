#!/bin/sh
# Runs a test program once with each mutant, "" being none, where CAN is (tests/uml/with_can.sh).
# Usage: where_can_is.sh PROGRAM MUTANT...; into $TETHER_CAN_RESULTS/mutant_NUMBER
program=$1
shift
for mutant in "$@"; do
    {
        TETHER_MUTANT=$mutant timeout 25 "$program" --gtest_fail_fast
        echo "exit code: $?"
    } >"$TETHER_CAN_RESULTS/mutant_$mutant" 2>&1
done
