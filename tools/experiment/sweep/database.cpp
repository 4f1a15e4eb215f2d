#include "tools/experiment/sweep/database.hpp"

#include <fmt/format.h>
#include <sqlite3.h>
#include <unistd.h>

#include <cctype>
#include <exception>
#include <stdexcept>

namespace tether {

namespace {

int flags_of(Database::Mode mode) {
  switch (mode) {
    case Database::Mode::read:
      return SQLITE_OPEN_READONLY | SQLITE_OPEN_URI;
    case Database::Mode::write:
      return SQLITE_OPEN_READWRITE;
    case Database::Mode::create:
      break;
  }
  return SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE;
}

/// A file that does not change, read without lock files because the folder is read-only.
std::string immutable_uri(const std::filesystem::path& file) {
  std::string uri = "file:";
  for (const char c : std::filesystem::absolute(file).string()) {
    const auto byte = static_cast<unsigned char>(c);
    const bool is_plain = std::isalnum(byte) != 0 || c == '/' || c == '.' || c == '-' || c == '_';
    uri += is_plain ? std::string(1, c) : fmt::format("%{:02X}", byte);
  }
  return uri + "?immutable=1";
}

bool is_writable(const std::filesystem::path& folder) { return access(folder.c_str(), W_OK) == 0; }

}  // namespace

Database::Database(const std::filesystem::path& file, Mode mode) : file_(file) {
  try {
    open(file.string(), mode);
  } catch (const std::exception&) {
    // A write-ahead log would have to be read too.
    const bool has_log = std::filesystem::exists(file.string() + "-wal");
    if (mode != Mode::read || has_log || is_writable(std::filesystem::absolute(file).parent_path()))
      throw;
    open(immutable_uri(file), mode);
  }
}

void Database::open(const std::string& name, Mode mode) {
  const int code = sqlite3_open_v2(name.c_str(), &handle_, flags_of(mode), nullptr);
  try {
    check(code, "opening it");
    sqlite3_busy_timeout(handle_, 10'000);
    // Opening reads nothing: this does, and finds what is no database, or a damaged one.
    execute("SELECT count(*) FROM sqlite_master");
  } catch (const std::exception&) {
    sqlite3_close(handle_);
    throw;
  }
}

Database::~Database() { sqlite3_close(handle_); }

void Database::execute(const std::string& sql) {
  check(sqlite3_exec(handle_, sql.c_str(), nullptr, nullptr, nullptr), sql);
}

void Database::check(int code, std::string_view attempt) const {
  if (code == SQLITE_OK || code == SQLITE_ROW || code == SQLITE_DONE) return;
  throw std::runtime_error(
      fmt::format("{}: {} ({})", file_.string(), sqlite3_errmsg(handle_), attempt));
}

Statement::Statement(const Database& database, const std::string& sql) : database_(database) {
  database.check(sqlite3_prepare_v2(database.handle_, sql.c_str(), -1, &handle_, nullptr), sql);
}

Statement::~Statement() { sqlite3_finalize(handle_); }

Statement& Statement::bind(int parameter, std::int64_t value) {
  database_.check(sqlite3_bind_int64(handle_, parameter + 1, value), "binding a number");
  return *this;
}

Statement& Statement::bind(int parameter, double value) {
  database_.check(sqlite3_bind_double(handle_, parameter + 1, value), "binding a number");
  return *this;
}

Statement& Statement::bind(int parameter, std::string_view value) {
  database_.check(sqlite3_bind_text(handle_, parameter + 1, value.data(),
                                    static_cast<int>(value.size()), SQLITE_TRANSIENT),
                  "binding a text");
  return *this;
}

Statement& Statement::bind_bytes(int parameter, std::span<const std::uint8_t> value) {
  database_.check(
      sqlite3_bind_blob64(handle_, parameter + 1, value.data(), value.size(), SQLITE_TRANSIENT),
      "binding bytes");
  return *this;
}

Statement& Statement::bind_nothing(int parameter) {
  database_.check(sqlite3_bind_null(handle_, parameter + 1), "binding nothing");
  return *this;
}

bool Statement::step() {
  const int code = sqlite3_step(handle_);
  if (code == SQLITE_ROW) return true;
  const int reset = sqlite3_reset(handle_);
  database_.check(code == SQLITE_DONE ? reset : code, sqlite3_sql(handle_));
  return false;
}

void Statement::run() {
  while (step()) {
  }
  sqlite3_clear_bindings(handle_);
}

std::int64_t Statement::whole(int column) const { return sqlite3_column_int64(handle_, column); }

double Statement::real(int column) const { return sqlite3_column_double(handle_, column); }

std::string Statement::text(int column) const {
  const auto bytes = this->bytes(column);
  return {bytes.begin(), bytes.end()};
}

bool Statement::is_nothing(int column) const {
  return sqlite3_column_type(handle_, column) == SQLITE_NULL;
}

std::span<const std::uint8_t> Statement::bytes(int column) const {
  const auto* begin = static_cast<const std::uint8_t*>(sqlite3_column_blob(handle_, column));
  return {begin, static_cast<std::size_t>(sqlite3_column_bytes(handle_, column))};
}

Transaction::Transaction(Database& database) : database_(database) {
  database_.execute("BEGIN IMMEDIATE");
}

Transaction::~Transaction() {
  if (!open_) return;
  try {
    database_.execute("ROLLBACK");
  } catch (const std::exception&) {  // there is nothing left to undo
  }
}

void Transaction::commit() {
  database_.execute("COMMIT");
  open_ = false;
}

}  // namespace tether
