#include "servosense/io/write_file.hpp"

#include "servosense/io/output_file.hpp"

namespace servosense {

Expected<Done> write_file(const std::string& path, std::string_view content) {
  auto file = OutputFile::open(path);
  if (!file) return file.error();
  if (auto done = file->write(content); !done) return done.error();
  return file->commit();
}

}  // namespace servosense
