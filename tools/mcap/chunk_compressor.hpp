#pragma once

#include <memory>
#include <string>
#include <string_view>

namespace tether {

/// Compresses chunks as zstd frames; the same bytes for the same input and version of libzstd.
class ChunkCompressor {
 public:
  ChunkCompressor();
  ~ChunkCompressor();
  ChunkCompressor(const ChunkCompressor&) = delete;
  ChunkCompressor& operator=(const ChunkCompressor&) = delete;

  /// Valid until the next call. Throws std::runtime_error with zstd's reason.
  std::string_view compress(std::string_view bytes);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace tether
