// Any bytes as a machine file: errors of a line each that name it, or a file that keeps every byte
// and can be changed and read again.
#include <cstdint>
#include <cstdlib>
#include <sstream>
#include <string>
#include <string_view>

#include "servosense/io/machine_file.hpp"

using namespace servosense;

namespace {

void require(bool ok) {
  if (!ok) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  Expected<MachineFile> file = MachineFile::parse(text, "fuzz");
  if (!file) {
    std::istringstream sentences(file.error().sentence);
    int count = 0;
    for (std::string line; std::getline(sentences, line); ++count)
      require(line.starts_with("fuzz:") || (count == 20 && line.starts_with("and ")));
    require(count >= 1 && count <= 21);
    return 0;
  }
  require(file->text() == text);

  file->set("spindle", "inertia_kg_m2", 0.125, "changed");
  file->set("machine", "name", std::string_view(text.substr(0, 40)));
  if (file->text("machine", "name")->empty()) file->remove("machine", "name");
  const Expected<MachineFile> again = MachineFile::parse(file->text(), "again");
  require(again.has_value());
  require(again->number("spindle", "inertia_kg_m2") == 0.125);
  require(again->text() == file->text());
  require(again->text("machine", "name") == file->text("machine", "name"));
  return 0;
}
