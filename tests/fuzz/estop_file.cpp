#include "can_bridge/node/estop_file.hpp"

#include <filesystem>
#include <fstream>

#include "tests/fuzz/fuzz.hpp"

namespace tether::fuzzing {
namespace {

const std::filesystem::path kPath = "estop.fuzz";

/// The only content that proves a clean end.
std::string clean_end() {
  std::string text = "tether e-stop record: ended";
  text.resize(511, ' ');
  return text + '\n';
}

void write(std::string_view text) {
  std::ofstream(kPath, std::ios::binary | std::ios::trunc) << text;
}

}  // namespace

/// An e-stop file of any content: all but a clean end starts a bridge latched, and so does all but
/// its own record once the bridge runs.
void try_input(std::span<const std::uint8_t> input) {
  const std::string text = text_of(input);
  write(text);
  {
    EstopFile file(kPath);
    must(file.latched() == (text != clean_end()), "only a clean end starts a bridge unlatched");
    file.remember(false, kStart);
    must(file.trouble().empty(), "a file that is taken is written");
    file.end();
  }
  must(!EstopFile(kPath).latched(), "an end in good order is one");
  must(EstopFile(kPath).latched(), "a bridge that was killed is not");
  EstopFile file(kPath);
  write(text);
  file.remember(true, kStart);
  must(!file.trouble().empty() || file.latched(), "a changed file is reported");
  file.end();
  must(EstopFile(kPath).latched(), "a latch outlives what was written by another");
  std::filesystem::remove(kPath);
}

}  // namespace tether::fuzzing
