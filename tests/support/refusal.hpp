#pragma once

#include <string>

#include "common/base/errors.hpp"

namespace tether {

/// Error text when `read` is refused; "accepted" if it is not.
template <class Read>
std::string refusal_of(Read read) {
  try {
    read();
  } catch (const UsageError& error) {
    return error.what();
  }
  return "accepted";
}

}  // namespace tether
