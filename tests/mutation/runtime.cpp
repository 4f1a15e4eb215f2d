// Linked with a test program whose sources hold mutants (mutate.py).
//   TETHER_MUTANT=n        mutant n is active
//   TETHER_MUTANT_TRACE=f  writes to file f, a line for each test: its name, its milliseconds, and
//                          the mutants whose places it reached
#include <gtest/gtest.h>

#include <chrono>
#include <cstdlib>
#include <fstream>
#include <vector>

namespace {

int number_of(const char* text) { return text == nullptr ? -1 : std::atoi(text); }

const char* const trace_file = std::getenv("TETHER_MUTANT_TRACE");
const int active = number_of(std::getenv("TETHER_MUTANT"));

std::vector<bool>& reached() {
  static std::vector<bool> numbers(65536);
  return numbers;
}

class Trace : public testing::EmptyTestEventListener {
 public:
  void OnTestSuiteStart(const testing::TestSuite&) override { begin(); }
  void OnTestStart(const testing::TestInfo&) override {
    started_ = std::chrono::steady_clock::now();
  }
  void OnTestEnd(const testing::TestInfo& test) override {
    const std::chrono::duration<double, std::milli> took =
        std::chrono::steady_clock::now() - started_;
    file_ << test.test_suite_name() << '.' << test.name() << ' ' << took.count();
    for (std::size_t i = 0; i < reached().size(); ++i) {
      if (reached()[i]) file_ << ' ' << i;
    }
    file_ << '\n';
    begin();
  }

 private:
  void begin() { reached().assign(reached().size(), false); }

  std::ofstream file_{trace_file};
  std::chrono::steady_clock::time_point started_;
};

const bool listens = [] {
  if (trace_file != nullptr) testing::UnitTest::GetInstance()->listeners().Append(new Trace);
  return true;
}();

}  // namespace

extern "C" bool tether_mutant(int number) {
  if (trace_file != nullptr) reached()[static_cast<std::size_t>(number)] = true;
  return number == active;
}
