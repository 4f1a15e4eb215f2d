#include <algorithm>
#include <vector>

#include "can_bridge/profiles/profiles.hpp"
#include "tests/fuzz/fuzz.hpp"
#include "tools/can/drive_import.hpp"

namespace tether::fuzzing {

/// A data sheet of a CANopen device. The skeleton of one that is taken is refused as a drivetrain
/// file until what it names as missing is filled in, and its text has each of those, in a line of
/// its own.
void try_input(std::span<const std::uint8_t> input) {
  takes([&] {
    const EdsFile eds = read_eds(text_of(input), "drive.eds");
    for (const std::vector<std::int64_t>& nodes :
         {std::vector<std::int64_t>{}, {5}, {1, 2}, {0x7F, 0x7F}}) {
      takes([&] {
        const DriveSkeleton skeleton = drive_skeleton(eds, "drive.eds", nodes);
        must(!skeleton.missing.empty(), "no data sheet says all");
        for (const std::string& what : skeleton.missing) {
          must(skeleton.text.find("# MISSING: " + what + "\n") != std::string::npos,
               "what is missing has its line");
        }
        must(std::none_of(skeleton.text.begin(), skeleton.text.end(),
                          [](unsigned char c) { return c < ' ' && c != '\n'; }),
             "a skeleton has no control characters");
        must(!takes([&] { parse_drivetrain(skeleton.text, "skeleton.toml"); }),
             "a skeleton is refused");
      });
    }
  });
}

}  // namespace tether::fuzzing
