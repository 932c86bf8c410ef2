// Any bytes as the header of a binary matrix, the last of them as its numbers: an error of one
// line, or a table of as many columns.
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <string>

#include "servosense/io/binary_matrix.hpp"
#include "servosense/io/import_plan.hpp"

using namespace servosense;

namespace {

void require(bool ok) {
  if (!ok) std::abort();
}

void write(const std::string& path, std::string_view bytes) {
  std::ofstream(path, std::ios::binary)
      .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  write("/tmp/servosense_fuzz_matrix.hdr", text);
  write("/tmp/servosense_fuzz_matrix.f32", text.substr(size - size / 4 / 4 * 4));
  const std::string path = "/tmp/servosense_fuzz_matrix.f32";
  const auto matrix = BinaryMatrix::open(path);
  auto file = TableFile::open(path);
  if (!matrix) {
    require(!file && matrix.error().sentence.find('\n') == std::string::npos);
    return 0;
  }
  if (!file) {
    require(file.error().sentence.find('\n') == std::string::npos);
    return 0;
  }
  ImportMap map;
  map.rate_hz = 1000;
  const auto plan = plan_import(*file, map);
  if (!plan) require(plan.error().sentence.find('\n') == std::string::npos);
  return 0;
}
