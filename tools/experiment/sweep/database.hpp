#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>

struct sqlite3;
struct sqlite3_stmt;

namespace tether {

/// An SQLite database. Everything throws std::runtime_error that names the file and says what
/// SQLite says ("database or disk is full").
class Database {
 public:
  enum class Mode : std::uint8_t { read, write, create };

  /// `create` makes the file if there is none. Refuses what is no database. `read` also works in a
  /// read-only folder, unless a write-ahead log is left there.
  Database(const std::filesystem::path& file, Mode mode);
  ~Database();
  Database(const Database&) = delete;
  Database& operator=(const Database&) = delete;

  /// Statements without results.
  void execute(const std::string& sql);

  const std::filesystem::path& file() const { return file_; }

 private:
  friend class Statement;
  void open(const std::string& name, Mode mode);
  void check(int code, std::string_view attempt) const;

  std::filesystem::path file_;
  sqlite3* handle_ = nullptr;
};

/// One prepared statement. Parameters and columns count from 0.
class Statement {
 public:
  /// `database` must outlive it.
  Statement(const Database& database, const std::string& sql);
  ~Statement();
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;

  Statement& bind(int parameter, std::int64_t value);
  Statement& bind(int parameter, double value);
  Statement& bind(int parameter, std::string_view value);
  Statement& bind_bytes(int parameter, std::span<const std::uint8_t> value);
  Statement& bind_nothing(int parameter);

  /// The next row; false after the last, and then the statement can be run again.
  bool step();
  /// Runs it to its end and unbinds the parameters.
  void run();

  std::int64_t whole(int column) const;
  double real(int column) const;
  std::string text(int column) const;
  bool is_nothing(int column) const;
  /// Valid until the next step.
  std::span<const std::uint8_t> bytes(int column) const;

 private:
  const Database& database_;
  sqlite3_stmt* handle_ = nullptr;
};

/// Begins a transaction; what has not been committed by the end of its life is undone.
class Transaction {
 public:
  explicit Transaction(Database& database);
  ~Transaction();
  Transaction(const Transaction&) = delete;
  Transaction& operator=(const Transaction&) = delete;

  void commit();

 private:
  Database& database_;
  bool open_ = true;
};

}  // namespace tether
