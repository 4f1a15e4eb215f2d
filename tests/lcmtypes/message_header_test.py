#!/usr/bin/env python3
"""message_header.py refuses what it does not know and says where: message_header_test.py LCM_GEN"""

import pathlib
import subprocess
import sys
import tempfile
import unittest

GENERATOR = pathlib.Path(__file__).parents[2] / "lcmtypes" / "message_header.py"
LCM_GEN = sys.argv.pop()


class MessageHeader(unittest.TestCase):
    def generate(self, text, name="tether_sample.lcm"):
        """Exit code, stderr with the folder as @, and the header or None."""
        with tempfile.TemporaryDirectory() as folder:
            file = pathlib.Path(folder, name)
            file.write_text(text)
            done = subprocess.run([sys.executable, GENERATOR, LCM_GEN, file, folder],
                                  capture_output=True, text=True)
            header = pathlib.Path(folder, "tether", "sample_t.hpp")
            return (done.returncode, done.stderr.replace(folder, "@"),
                    header.read_text() if header.exists() else None)

    def assert_refused(self, text, error):
        code, stderr, header = self.generate(text)
        self.assertEqual(code, 1)
        self.assertIn(error, stderr)
        self.assertIsNone(header)

    def assert_field_refused(self, field, why):
        self.assert_refused(f"package tether;\n// n\nstruct sample_t {{\n  int32_t n;\n  {field}\n}}\n",
                            f"@/tether_sample.lcm:5: {why}")

    def test_fields_are_visited_in_the_order_of_the_file_with_the_count_of_an_array(self):
        code, stderr, header = self.generate(
            "package tether; struct sample_t { int32_t n; string b[n]; double a, c[3]; }")
        self.assertEqual((code, stderr), (0, ""))
        visits = [line.strip() for line in header.splitlines() if "visit(" in line]
        self.assertEqual(visits, ['visit("n", message.n);', 'visit("b", message.b, message.n);',
                                  'visit("a", message.a);', 'visit("c", message.c);'])

    def test_a_message_inside_a_message_is_refused(self):
        self.assert_field_refused("pose_t pose;", "the type of pose is not one of boolean, byte, ")

    def test_an_int8_is_refused(self):
        self.assert_field_refused("int8_t small;", "the type of small is not one of boolean, byte, ")

    def test_two_dimensions_are_refused(self):
        self.assert_field_refused("double matrix[3][n];", "matrix has more than one dimension")

    def test_a_wrong_line_is_refused_by_lcm_gen(self):
        self.assert_refused("package tether;\nstruct sample_t {\n  double m[3;\n}\n",
                            "@/tether_sample.lcm:3:\n")

    def test_an_unknown_count_is_refused_by_lcm_gen(self):
        self.assert_refused("package tether;\nstruct sample_t {\n  double m[n];\n}\n",
                            "@/tether_sample.lcm:3:\n")

    def test_a_second_struct_or_an_enum_is_refused(self):
        sample = "package tether;\nstruct sample_t {\n  int32_t n;\n}\n"
        why = "a file holds one struct and nothing else, here tether.sample_t\n"
        for more in "struct other_t { int32_t n; }", "enum kind_t { A=0, B=1 }":
            self.assert_refused(sample + more, f"@/tether_sample.lcm:5: {why}")

    def test_a_struct_of_another_name_package_or_no_struct_is_refused(self):
        why = "a file holds one struct and nothing else, here tether.sample_t\n"
        self.assert_refused("package tether;\nstruct other_t { int32_t n; }",
                            f"@/tether_sample.lcm:2: {why}")
        self.assert_refused("package a;\nstruct sample_t { int32_t n; }", f"tether_sample.lcm: {why}")
        self.assert_refused("", f"tether_sample.lcm: {why}")

    def test_a_missing_file_is_refused(self):
        done = subprocess.run([sys.executable, GENERATOR, LCM_GEN, "/missing.lcm", "/tmp"],
                              capture_output=True, text=True)
        self.assertEqual(done.returncode, 1)
        self.assertIn("/missing.lcm", done.stderr)


if __name__ == "__main__":
    unittest.main()
