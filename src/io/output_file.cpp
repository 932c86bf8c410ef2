#include "servosense/io/output_file.hpp"

#include <fcntl.h>
#include <poll.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <system_error>
#include <utility>

#include "servosense/io/file_identity.hpp"
#include "servosense/io/text.hpp"

namespace servosense {
namespace {

constexpr int kNew = O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC;
constexpr mode_t kMode = 0666;  // less what the user's umask takes away

std::string folder_of(const std::string& path) {
  const std::string folder = std::filesystem::path(path).parent_path().string();
  return folder.empty() ? "." : folder;
}

std::string descriptor_name(int fd) { return "/proc/self/fd/" + std::to_string(fd); }

/// The name of no file beside `path`; hidden, and short whatever the file is called.
std::string part_name(const std::string& path, int n) {
  return folder_of(path) + "/.servosense-" + std::to_string(::getpid()) + '-' + std::to_string(n) +
         ".part";
}

/// `make(name)` with names that are free; -1 with errno.
template <typename Make>
int with_free_name(const std::string& path, std::string& name, Make make) {
  for (int n = 0;; ++n) {
    name = part_name(path, n);
    const int made = make(name.c_str());
    if (made >= 0 || errno != EEXIST) return made;
  }
}

/// Standard output or standard error, redirected to this file: written on where they stand.
int same_as_stream(const struct stat& file) {
  for (const int fd : {STDOUT_FILENO, STDERR_FILENO}) {
    struct stat stream {};
    if (::fstat(fd, &stream) == 0 && stream.st_dev == file.st_dev && stream.st_ino == file.st_ino)
      return fd;
  }
  return -1;
}

}  // namespace

OutputFile::OutputFile(OutputFile&& other) noexcept { *this = std::move(other); }

OutputFile& OutputFile::operator=(OutputFile&& other) noexcept {
  if (this == &other) return *this;
  close();
  name_ = std::move(other.name_);
  path_ = std::move(other.path_);
  part_ = std::exchange(other.part_, {});
  fd_ = std::exchange(other.fd_, -1);
  whole_ = other.whole_;
  regular_ = other.regular_;
  size_ = other.size_;
  failure_ = std::move(other.failure_);
  return *this;
}

OutputFile::~OutputFile() { close(); }

void OutputFile::close() noexcept {
  if (fd_ >= 0) ::close(fd_);
  fd_ = -1;
  if (!part_.empty()) ::unlink(part_.c_str());
  part_.clear();
}

Error OutputFile::error(const char* what) const {
  const std::string reason = std::generic_category().message(errno);
  return device_error(printable(name_, 400) + ": " + what + " (" + reason +
                      "); check the path, the right to write there and the room on the disk");
}

Expected<OutputFile> OutputFile::open(const std::string& path, Kind kind) {
  OutputFile file;
  file.name_ = path;
  file.path_ = behind_links(path);
  struct stat old {};
  const bool exists = ::stat(path.c_str(), &old) == 0;
  const auto refused = [&] { return file.error("cannot be written"); };
  if (exists && S_ISDIR(old.st_mode)) {
    errno = EISDIR;
    return refused();
  }
  file.regular_ = !exists || S_ISREG(old.st_mode);
  const int stream = exists ? same_as_stream(old) : -1;
  if (stream >= 0 || !file.regular_ || kind == Kind::growing) {
    if (stream >= 0) file.regular_ = false;  // it is another's, too
    file.fd_ = stream >= 0 ? ::fcntl(stream, F_DUPFD_CLOEXEC, 3)
                           : ::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, kMode);
    if (file.fd_ < 0) return refused();
    return file;
  }
  // A file that its owner has locked stays as it is, though its folder would let it be replaced.
  if (exists && ::access(path.c_str(), W_OK) != 0) return refused();
  file.whole_ = true;
  // Without a name until it is complete, where the file system can: then a killed run leaves none.
  file.fd_ = ::open(folder_of(file.path_).c_str(), O_TMPFILE | O_WRONLY | O_CLOEXEC, kMode);
  if (file.fd_ >= 0 && ::access(descriptor_name(file.fd_).c_str(), F_OK) != 0) file.close();
  if (file.fd_ < 0) {
    std::string part;
    file.fd_ = with_free_name(file.path_, part,
                              [](const char* name) { return ::open(name, kNew, kMode); });
    if (file.fd_ < 0) return refused();
    file.part_ = part;
  }
  if (exists) {
    [[maybe_unused]] const int owner = ::fchown(file.fd_, old.st_uid, old.st_gid);  // if it may
    if (::fchmod(file.fd_, old.st_mode & 07777U) != 0) return refused();
  }
  return file;
}

Expected<OutputFile> OutputFile::standard_output() {
  OutputFile file;
  file.name_ = "standard output";
  file.fd_ = ::fcntl(STDOUT_FILENO, F_DUPFD_CLOEXEC, 3);
  if (file.fd_ < 0) return file.error("cannot be written");
  return file;
}

Expected<Done> OutputFile::write(std::string_view bytes) {
  if (failure_) return *failure_;
  std::size_t done = 0;
  while (done < bytes.size()) {
    const ssize_t n = ::write(fd_, bytes.data() + done, bytes.size() - done);
    if (n >= 0) {
      done += static_cast<std::size_t>(n);
      continue;
    }
    if (errno == EINTR) continue;
    if (errno == EAGAIN) {
      pollfd room{fd_, POLLOUT, 0};
      ::poll(&room, 1, -1);
      continue;
    }
    const Error why = error("not everything could be written");
    const bool cut_back =
        regular_ && !whole_ &&
        (done == 0 || (::ftruncate(fd_, size_) == 0 && ::lseek(fd_, size_, SEEK_SET) == size_));
    if (regular_ && !cut_back) failure_ = why;
    return why;
  }
  size_ += static_cast<long long>(done);
  return Done{};
}

Expected<Done> OutputFile::commit() {
  if (fd_ < 0) return Done{};
  auto done = failure_ ? Expected<Done>(*failure_) : put_in_place();
  close();
  return done;
}

Expected<Done> OutputFile::put_in_place() {
  // What cannot be synced, as a pipe, is not on a disk.
  if (::fsync(fd_) != 0 && errno != EINVAL && errno != EROFS && errno != ENOTSUP)
    return error("not everything could be written");
  if (!whole_) return Done{};
  if (part_.empty()) {
    const std::string nameless = descriptor_name(fd_);
    std::string part;
    if (with_free_name(path_, part, [&](const char* name) {
          return ::linkat(AT_FDCWD, nameless.c_str(), AT_FDCWD, name, AT_SYMLINK_FOLLOW);
        }) < 0)
      return error("cannot be put in its place");
    part_ = part;
  }
  if (std::rename(part_.c_str(), path_.c_str()) != 0) return error("cannot be put in its place");
  part_.clear();
  const int folder = ::open(folder_of(path_).c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (folder >= 0) {
    ::fsync(folder);
    ::close(folder);
  }
  return Done{};
}

Expected<Done> check_writable(const std::string& path) {
  struct stat old {};
  const bool special =
      ::stat(path.c_str(), &old) == 0 && !S_ISREG(old.st_mode) && !S_ISDIR(old.st_mode);
  // To open a pipe is to wait for its reader.
  if (special) return Done{};
  auto file = OutputFile::open(path);
  if (!file) return file.error();
  return Done{};
}

}  // namespace servosense
