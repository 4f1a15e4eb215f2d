#include "tools/experiment/sweep/seeds.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <numeric>
#include <set>

namespace tether {
namespace {

std::vector<std::uint64_t> seeds_from(std::int64_t first, std::int64_t count) {
  std::vector<std::uint64_t> seeds(static_cast<std::size_t>(count));
  std::iota(seeds.begin(), seeds.end(), first);
  return seeds;
}

}  // namespace

std::vector<std::uint64_t> read_seeds(const Section& file, const std::string& name) {
  const toml::node* node = file.get("seeds");
  if (node == nullptr)
    file.refuse("seeds", "given: how many, or the first and the last, or a list");
  if (const auto* range = node->as_table()) {
    const Section section(*range, "seeds.", name, {"first", "last"});
    for (const char* key : {"first", "last"}) {
      if (section.get(key) == nullptr) section.refuse(key, "given");
    }
    const std::int64_t first = section.whole("first", 0, 0);
    return seeds_from(first, section.whole("last", first, 0) - first + 1);
  }
  const auto* list = node->as_array();
  if (list == nullptr) return seeds_from(1, file.whole("seeds", 1, 1));
  std::vector<std::uint64_t> seeds;
  std::set<std::int64_t> seen;
  for (const toml::node& entry : *list) {
    const auto* seed = entry.as_integer();
    if (seed == nullptr || seed->get() < 0 || !seen.insert(seed->get()).second) {
      file.refuse("seeds", "whole numbers from 0 on, each once");
    }
    seeds.push_back(static_cast<std::uint64_t>(seed->get()));
  }
  if (seeds.empty()) file.refuse("seeds", "one seed or more");
  return seeds;
}

std::string seeds_text(const std::vector<std::uint64_t>& seeds) {
  if (seeds.empty()) return "none";
  for (std::size_t i = 0; i < seeds.size(); ++i) {
    if (seeds[i] != seeds.front() + i) return fmt::format("{}", fmt::join(seeds, ", "));
  }
  return fmt::format("{} to {}", seeds.front(), seeds.back());
}

}  // namespace tether
