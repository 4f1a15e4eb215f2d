#include "common/world/pgm.hpp"

#include <fmt/format.h>

#include <charconv>
#include <string_view>

#include "common/base/errors.hpp"
#include "common/base/input_file.hpp"
#include "common/base/text.hpp"

namespace tether {
namespace {

constexpr std::uint32_t kMostPixelsASide = 50'000;
constexpr std::uint32_t kWhitest = 65'535;

class PgmReader {
 public:
  PgmReader(std::string file, std::string_view bytes) : file_(std::move(file)), rest_(bytes) {}

  Pgm read() {
    const std::string_view magic = rest_.substr(0, 2);
    if (magic != "P2" && magic != "P5") {
      refuse(fmt::format("begins with \"{}\": must be a PGM image, P2 or P5", printable(magic)));
    }
    rest_.remove_prefix(2);
    Pgm pgm;
    pgm.columns = number("the width", 1, kMostPixelsASide);
    pgm.rows = number("the height", 1, kMostPixelsASide);
    pgm.white = number("the largest value", 1, kWhitest);
    const std::size_t count = pgm.columns * pgm.rows;
    if (magic == "P2") {
      // Each takes a digit and a blank: what cannot be there gets no memory.
      if (rest_.size() < count) truncated(count);
      pgm.pixels.reserve(count);
      for (std::size_t i = 0; i < count; ++i) {
        skip_blanks();
        if (rest_.empty()) truncated(count);
        pgm.pixels.push_back(static_cast<std::uint16_t>(number("a pixel", 0, pgm.white)));
      }
      check_end(pgm);
      return pgm;
    }
    if (rest_.empty() || !is_blank(rest_.front())) refuse("has no pixels behind its largest value");
    rest_.remove_prefix(1);
    read_bytes(pgm, count);
    check_end(pgm);
    return pgm;
  }

 private:
  static bool is_blank(char c) {
    return std::string_view(" \t\r\n\v\f").find(c) != std::string_view::npos;
  }

  [[noreturn]] void refuse(const std::string& what) const {
    throw UsageError(fmt::format("{}: the map's image {}", file_, what));
  }
  [[noreturn]] void truncated(std::size_t count) const {
    refuse(fmt::format("is cut off: it has fewer than the {} pixels that it announces", count));
  }

  void skip_blanks() {
    while (!rest_.empty()) {
      if (rest_.front() == '#') {
        rest_.remove_prefix(std::min(rest_.size(), rest_.find('\n')));
      } else if (is_blank(rest_.front())) {
        rest_.remove_prefix(1);
      } else {
        return;
      }
    }
  }

  std::uint32_t number(const char* what, std::uint32_t low, std::uint32_t high) {
    skip_blanks();
    std::uint32_t value = 0;
    const auto [end, error] = std::from_chars(rest_.data(), rest_.data() + rest_.size(), value);
    if (error != std::errc{} || value < low || value > high) {
      refuse(fmt::format("is not readable: {} = \"{}\" must be a whole number in [{}, {}]", what,
                         printable(rest_.substr(0, rest_.find_first_of(" \t\r\n")), 20), low,
                         high));
    }
    rest_.remove_prefix(static_cast<std::size_t>(end - rest_.data()));
    return value;
  }

  void read_bytes(Pgm& pgm, std::size_t count) {
    const std::size_t each = pgm.white > 255 ? 2 : 1;
    if (rest_.size() < each * count) truncated(count);
    pgm.pixels.reserve(count);
    const auto byte = [this](std::size_t i) { return static_cast<unsigned char>(rest_[i]); };
    for (std::size_t i = 0; i < count; ++i) {
      const unsigned value = each == 1 ? byte(i) : byte(2 * i) * 256U + byte(2 * i + 1);
      if (value > pgm.white) {
        refuse(fmt::format("is not readable: a pixel has {}, but the header's maximum is {}", value,
                           pgm.white));
      }
      pgm.pixels.push_back(static_cast<std::uint16_t>(value));
    }
    rest_.remove_prefix(each * count);
  }

  /// Refuses data after the image: with a wrong size in the header, a wrong image would be read.
  void check_end(const Pgm& pgm) {
    skip_blanks();
    if (rest_.empty()) return;
    refuse(
        fmt::format("is larger than the {} x {} pixels that it announces", pgm.columns, pgm.rows));
  }

  std::string file_;
  std::string_view rest_;
};

}  // namespace

Pgm load_pgm(const std::string& file, const std::string& what) {
  const std::string bytes = read_input(file, what, kMostTableBytes);
  return PgmReader(file, bytes).read();
}

}  // namespace tether
