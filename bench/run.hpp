#pragma once

#include <benchmark/benchmark.h>
#include <fmt/format.h>

#include <cerrno>
#include <cstdio>
#include <exception>
#include <functional>

namespace tether::bench {

/// The main() of benchmarks that start processes, and so may fail: says why, and returns 1. `then`
/// is called after them.
inline int run_benchmarks(
    int argc, char** argv, const std::function<void()>& then = [] {}) {
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
  try {
    const std::size_t run = benchmark::RunSpecifiedBenchmarks();
    then();
    return run > 0 ? 0 : 1;
  } catch (const std::exception& error) {
    fmt::print(stderr, "{}: {}\n", program_invocation_short_name, error.what());
    return 1;
  }
}

}  // namespace tether::bench
