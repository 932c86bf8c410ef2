// Whether two names are the same file: through links, and before the file is there.
#pragma once

#include <optional>
#include <string>
#include <utility>

namespace servosense {

/// What `path` leads to behind symbolic links; the last may point to what is not there yet.
[[nodiscard]] std::string behind_links(const std::string& path);

struct FileIdentity {
  std::pair<unsigned long long, unsigned long long> node;  ///< device and inode
  std::string name;  ///< of a file that is not there yet, in the folder that `node` then is
  bool operator==(const FileIdentity&) const = default;
};
/// Nothing for devices, pipes and sockets, that no writing destroys, and where there is no folder.
[[nodiscard]] std::optional<FileIdentity> file_identity(const std::string& path);

}  // namespace servosense
