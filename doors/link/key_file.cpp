#include "doors/link/key_file.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sodium.h>
#include <sys/stat.h>
#include <toml++/toml.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "common/base/errors.hpp"

namespace tether::link {
namespace {

constexpr std::size_t kMostKeyFileBytes = 4096;

[[noreturn]] void refuse(const std::string& file, const std::string& why) {
  throw UsageError(fmt::format("key file \"{}\": {}", file, why));
}
[[noreturn]] void refuse_call(const std::string& file, const char* attempt) {
  refuse(file, fmt::format("{}: {}", attempt, std::strerror(errno)));
}

/// Closes at the end.
struct Descriptor {
  int fd;
  ~Descriptor() {
    if (fd >= 0) close(fd);
  }
};

/// Looks at what is open, not at a name that may be another file by now.
std::string read_secret(const std::string& file) {
  const Descriptor in{open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK)};
  if (in.fd < 0) {
    const int error = errno;
    refuse(file, fmt::format("cannot be opened: {}{}", std::strerror(error),
                             error == ENOENT   ? "; `tether-link keygen FILE` makes one"
                             : error == EACCES ? "; it must belong to who runs this (chown)"
                                               : ""));
  }
  struct stat about {};
  if (fstat(in.fd, &about) != 0) refuse_call(file, "cannot be looked at");
  if (!S_ISREG(about.st_mode)) refuse(file, "is no regular file");
  if (about.st_uid != geteuid() && about.st_uid != 0 && geteuid() != 0) {
    refuse(file,
           fmt::format("belongs to user {}: must be owned by who runs this (chown)", about.st_uid));
  }
  if ((about.st_mode & 077) != 0) {
    refuse(file, fmt::format("mode {:04o} lets others in, must be 0600: chmod 600 {}",
                             about.st_mode & 07777, file));
  }
  std::string text(kMostKeyFileBytes + 1, '\0');
  const ssize_t size = read(in.fd, text.data(), text.size());
  if (size < 0) refuse_call(file, "cannot be read");
  if (static_cast<std::size_t>(size) > kMostKeyFileBytes) refuse(file, "is too long for a key");
  text.resize(static_cast<std::size_t>(size));
  return text;
}

/// Says nothing of the value, which may be a secret in the wrong place.
Key key_at(const toml::table& table, const std::string& file, const std::string& name) {
  const auto text = table[name].value_exact<std::string>();
  const std::optional<Key> key = text ? key_from_text(*text) : std::nullopt;
  if (!key) refuse(file, fmt::format("{} must be 64 hexadecimal digits in quotes", name));
  return *key;
}

}  // namespace

void write_key_file(const std::string& file, const KeyPair& pair) {
  const Descriptor out{open(file.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600)};
  if (out.fd < 0) {
    refuse(file, errno == EEXIST
                     ? std::string("exists already, and a key is never overwritten: give another "
                                   "name, or remove it first")
                     : fmt::format("cannot be made: {}", std::strerror(errno)));
  }
  std::string text = fmt::format(
      "# Key of tether-link: keep it secret. Others need the public key only.\n"
      "secret_key = \"{}\"\npublic_key = \"{}\"\n",
      key_text(pair.secret_key), key_text(pair.public_key));
  const bool done = fchmod(out.fd, 0600) == 0 &&
                    write(out.fd, text.data(), text.size()) == static_cast<ssize_t>(text.size()) &&
                    fsync(out.fd) == 0;
  const int error = errno;
  sodium_memzero(text.data(), text.size());
  if (!done) {
    unlink(file.c_str());
    errno = error;
    refuse_call(file, "cannot be written");
  }
}

KeyPair read_key_file(const std::string& file) {
  std::string text = read_secret(file);
  toml::table table;
  try {
    table = toml::parse(text, file);
  } catch (const toml::parse_error& error) {  // without quoting what may be a secret
    refuse(file, fmt::format("line {}: not TOML; `tether-link keygen FILE` makes another",
                             error.source().begin.line));
  }
  sodium_memzero(text.data(), text.size());
  const KeyPair pair = key_pair_with(key_at(table, file, "secret_key"));
  if (pair.public_key != key_at(table, file, "public_key")) {
    refuse(file, "its public key is not its secret key's: it is damaged");
  }
  return pair;
}

void check_only_owner_writes(const std::string& file) {
  struct stat about {};
  if (stat(file.c_str(), &about) != 0) return;  // reading it reports the reason
  if (about.st_uid != 0 && about.st_uid != geteuid()) {
    throw UsageError(
        fmt::format("\"{}\" is another user's, who can write whom this host trusts: chown root {}",
                    file, file));
  }
  if ((about.st_mode & 022) != 0) {
    throw UsageError(
        fmt::format("\"{}\": mode {:04o} lets others write whom this host trusts: chmod go-w {}",
                    file, about.st_mode & 07777, file));
  }
}

}  // namespace tether::link
