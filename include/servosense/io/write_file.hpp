// Writing a whole file.
#pragma once

#include <string>
#include <string_view>

#include "servosense/core/expected.hpp"

namespace servosense {

/// Creates or replaces a file, whole or not at all (OutputFile). Device error, naming the file,
/// unless all of it was written.
Expected<Done> write_file(const std::string& path, std::string_view content);

}  // namespace servosense
