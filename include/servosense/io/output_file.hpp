// A file that is written: whole or not at all, or growing while others read it.
//
// A whole file is written beside its place, synced and renamed there by commit(): whoever kills the
// program, fills the disk or pulls the plug leaves the file of before, or none. A growing file, of
// a live run, holds whole pieces: what does not fit is taken back, and the next write tries again.
// The file keeps its permissions; a symbolic link stays one, and what it points to is replaced.
// Devices, pipes and what standard output is redirected to are written as they are.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "servosense/core/expected.hpp"

namespace servosense {

class OutputFile {
 public:
  enum class Kind { whole, growing };

  /// Device error, naming the file, when it could not be written there.
  static Expected<OutputFile> open(const std::string& path, Kind kind = Kind::whole);
  /// Beside what the program prints.
  static Expected<OutputFile> standard_output();
  OutputFile(OutputFile&& other) noexcept;
  OutputFile& operator=(OutputFile&& other) noexcept;
  /// Without commit() a whole file has never been.
  ~OutputFile();

  /// All of it or, of a growing file, nothing. A whole file that failed once fails for good.
  Expected<Done> write(std::string_view bytes);
  /// Puts the file in its place. Device error unless everything is on the disk; once.
  Expected<Done> commit();

 private:
  OutputFile() = default;
  [[nodiscard]] Error error(const char* what) const;
  Expected<Done> put_in_place();
  void close() noexcept;

  std::string name_;  // as it was given
  std::string path_;  // behind links
  std::string part_;  // written instead, until commit(); empty: path_ itself, or no name yet
  int fd_ = -1;
  bool whole_ = false;            // goes to its place with commit()
  bool regular_ = false;          // can be cut back
  long long size_ = 0;            // of whole pieces, of a growing file
  std::optional<Error> failure_;  // for good
};

/// Device error when nothing could be written at `path`; writes nothing.
Expected<Done> check_writable(const std::string& path);

}  // namespace servosense
