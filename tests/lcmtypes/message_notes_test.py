#!/usr/bin/env python3
"""message_notes.py gives each comment of an .lcm file to what it belongs to."""

import pathlib
import subprocess
import sys
import tempfile
import unittest

GENERATOR = pathlib.Path(__file__).parents[2] / "lcmtypes" / "message_notes.py"
SAMPLE = """\
package tether;

// What it is,
// in two lines.
struct sample_t {
  int64_t utime;      // one
                      // comment
  // For the next two.
  double x_m, y_m;    // not ours: one field a line
  string a[n];
  // About b:
  string b[3];        // a "text"
  // Ends here.

  const int32_t UP = -1;  // up,
                          // or not
}
"""


class MessageNotes(unittest.TestCase):
    def test_comments_belong_to_what_is_before_them_or_below(self):
        with tempfile.TemporaryDirectory() as folder:
            file = pathlib.Path(folder, "tether_sample.lcm")
            file.write_text(SAMPLE)
            subprocess.run([sys.executable, GENERATOR, folder, file], check=True)
            notes = pathlib.Path(folder, "tether", "message_notes.inc").read_text().splitlines()[1:]
        self.assertEqual(notes, [
            'TETHER_MESSAGE("sample_t", "What it is, in two lines.")',
            'TETHER_FIELD("sample_t", "utime", "one comment")',
            'TETHER_FIELD("sample_t", "a", "")',
            'TETHER_FIELD("sample_t", "b", "About b: a \\"text\\"")',
            'TETHER_CONSTANT("sample_t", "UP", -1, "up, or not")',
        ])


if __name__ == "__main__":
    unittest.main()
