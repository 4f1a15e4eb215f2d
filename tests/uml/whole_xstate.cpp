// For LD_PRELOAD into User-Mode Linux 6.1, on processors with AMX. The kernel takes a process's
// extended state (XSAVE) back as a whole only, and with AMX that is 11 kB; User-Mode Linux keeps
// 2696 bytes of it and would end. Here the rest is what the process has already.

#include <dlfcn.h>
#include <sys/ptrace.h>
#include <sys/uio.h>

#include <array>
#include <cstdarg>
#include <cstdint>
#include <cstring>

namespace {

constexpr long kXstate = 0x202;  // NT_X86_XSTATE of elf.h

}  // namespace

extern "C" long ptrace(__ptrace_request request, ...) noexcept {
  using Ptrace = long (*)(__ptrace_request, pid_t, void*, void*);
  static const auto kPtrace = reinterpret_cast<Ptrace>(dlsym(RTLD_NEXT, "ptrace"));
  va_list arguments;
  va_start(arguments, request);
  const pid_t pid = va_arg(arguments, pid_t);
  void* address = va_arg(arguments, void*);
  void* data = va_arg(arguments, void*);
  va_end(arguments);
  if (request != PTRACE_SETREGSET || reinterpret_cast<long>(address) != kXstate) {
    return kPtrace(request, pid, address, data);
  }
  static std::array<std::uint8_t, 65536> whole;  // one thread alone traces, and its stack is small
  iovec part{whole.data(), whole.size()};
  if (const long failed = kPtrace(PTRACE_GETREGSET, pid, address, &part)) return failed;
  const iovec* kept = static_cast<const iovec*>(data);
  if (kept->iov_len < part.iov_len) std::memcpy(whole.data(), kept->iov_base, kept->iov_len);
  return kPtrace(request, pid, address, kept->iov_len < part.iov_len ? &part : data);
}
