// What some programs put at the start of a text file.
#pragma once

#include <string_view>

namespace servosense {

inline constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";  // of UTF-8

}  // namespace servosense
