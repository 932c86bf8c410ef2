#include "servosense/io/write_file.hpp"

#include <cerrno>
#include <fstream>
#include <system_error>

#include "servosense/io/text.hpp"

namespace servosense {

Expected<Done> write_file(const std::string& path, std::string_view content) {
  errno = 0;
  std::ofstream file(path, std::ios::binary);
  file.write(content.data(), static_cast<std::streamsize>(content.size()));
  file.close();
  if (file) return Done{};
  const std::string reason = errno != 0 ? std::generic_category().message(errno) : "unknown reason";
  return device_error(printable(path, 400) + ": cannot be written (" + reason +
                      "); check the path, the right to write there and the room on the disk");
}

}  // namespace servosense
