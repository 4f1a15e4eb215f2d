#include <ode/ode.h>

#include <cstdarg>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <mutex>

#include "sim/plant/ode_world.hpp"

namespace tether {
namespace {

thread_local std::uint64_t t_complaints = 0;

void count_complaint(int, const char*, va_list) { ++t_complaints; }

[[noreturn]] void die(const char* kind, int number, const char* format, va_list arguments) {
  std::fprintf(stderr, "tether: ODE %s %d: ", kind, number);
  std::vfprintf(stderr, format, arguments);
  std::fprintf(stderr, "\n");
  std::abort();
}

void on_error(int number, const char* format, va_list arguments) {
  die("error", number, format, arguments);
}

void on_debug(int number, const char* format, va_list arguments) {
  die("internal error", number, format, arguments);
}

struct OdeThreadData {
  OdeThreadData() { dAllocateODEDataForThread(dAllocateMaskAll); }
  ~OdeThreadData() { dCleanupODEAllDataForThread(); }
  OdeThreadData(const OdeThreadData&) = delete;
  OdeThreadData& operator=(const OdeThreadData&) = delete;
};

}  // namespace

void prepare_ode_thread() {
  static std::once_flag once;
  std::call_once(once, [] {
    dInitODE2(0);
    dSetMessageHandler(count_complaint);
    dSetErrorHandler(on_error);
    dSetDebugHandler(on_debug);
  });
  thread_local OdeThreadData data;
}

std::uint64_t ode_complaints_of_this_thread() { return t_complaints; }

}  // namespace tether
