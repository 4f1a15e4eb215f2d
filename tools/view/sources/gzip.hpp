#pragma once

#include <string>
#include <string_view>

namespace tether {

/// In the format of RFC 1952, without a name and a time: the same bytes for the same bytes.
std::string gzip(std::string_view bytes);

/// RFC 4648, section 4: with padding, without line breaks.
std::string base64(std::string_view bytes);

}  // namespace tether
