#include "servosense/io/file_identity.hpp"

#include <sys/stat.h>

#include <filesystem>

namespace servosense {

std::string behind_links(const std::string& path) {
  namespace fs = std::filesystem;
  constexpr int kMostLinks = 40;  // as the kernel allows
  fs::path at = path;
  std::error_code failed;
  for (int n = 0; n < kMostLinks && fs::is_symlink(at, failed); ++n) {
    const fs::path to = fs::read_symlink(at, failed);
    if (failed) break;
    at = to.is_absolute() ? to : at.parent_path() / to;
  }
  return at.string();
}

std::optional<FileIdentity> file_identity(const std::string& path) {
  struct stat found {};
  if (::stat(path.c_str(), &found) == 0) {
    if (!S_ISREG(found.st_mode) && !S_ISDIR(found.st_mode)) return std::nullopt;
    return FileIdentity{{found.st_dev, found.st_ino}, ""};
  }
  const std::filesystem::path to = behind_links(path);
  const std::string folder = to.has_parent_path() ? to.parent_path().string() : ".";
  if (::stat(folder.c_str(), &found) != 0) return std::nullopt;
  return FileIdentity{{found.st_dev, found.st_ino}, to.filename().string()};
}

}  // namespace servosense
