#include "output_check.hpp"

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <fstream>

#include "servosense/io/file_identity.hpp"
#include "servosense/io/output_file.hpp"
#include "servosense/io/text.hpp"

namespace servosense::cli {
namespace {

namespace fs = std::filesystem;

struct NamedFile {
  std::string said;  // as the user names it: "--trace cut.csv"
  std::string path;
};

std::string said(const std::string& option, const std::string& path) {
  return option + " " + printable(path, 400);
}

// Machine files and maps name further files, beside themselves: `reference = band.csv`. Whatever a
// key is called, what it gives the name of a file there for is one.
void add_named_in(const std::string& path, std::vector<NamedFile>& files) {
  constexpr std::uintmax_t kLargest = 1U << 20U;  // those are small; a record is none of them
  std::error_code none;
  if (!fs::is_regular_file(path, none) || fs::file_size(path, none) > kLargest) return;
  std::ifstream in(path);
  for (std::string line; std::getline(in, line);) {
    const std::size_t equals = line.find('=');
    if (equals == std::string::npos) continue;
    const std::string value(trim(std::string_view(line).substr(equals + 1)));
    const std::string name = value.substr(0, value.find_first_of("#;"));
    const fs::path named = fs::path(path).parent_path() / std::string(trim(name));
    if (!trim(name).empty() && fs::is_regular_file(named, none))
      files.push_back({named.string() + ", which " + path + " names", named.string()});
  }
}

bool same(const std::optional<FileIdentity>& a, const std::string& b) {
  return a && a == file_identity(b);
}

}  // namespace

Expected<Done> check_rereadable(const std::string& path) {
  std::error_code none;
  if (!fs::is_fifo(path, none) && !fs::is_character_file(path, none) && !fs::is_socket(path, none))
    return Done{};
  return usage_error(printable(path, 400) +
                     ": is read more than once, which a pipe or device cannot be; give a file");
}

Expected<Done> check_outputs(const Command& command, const Arguments& arguments) {
  std::vector<NamedFile> inputs, named, outputs;
  bool renews = false;
  std::vector<std::string> folders;
  for (const Option& option : command.options) {
    const auto path = arguments.value(option.name);
    const bool stream = path == "-" && option.value.ends_with("|-");
    if (!path || stream) continue;
    const NamedFile file{said(option.name, *path), *path};
    if (option.use == FileUse::input || option.use == FileUse::reread) inputs.push_back(file);
    if (option.use == FileUse::reread)
      if (auto done = check_rereadable(*path); !done) return done.error();
    if (option.use == FileUse::output || option.use == FileUse::renewed) outputs.push_back(file);
    if (option.use == FileUse::renewed) renews = true;
    if (option.use == FileUse::folder) folders.push_back(*path);
    for (const std::string& in_folder : option.in_folder) {
      const std::string inside = (fs::path(*path) / in_folder).string();
      outputs.push_back({file.said + " (" + in_folder + ")", inside});
    }
  }
  for (const std::string& path : arguments.operands())
    inputs.push_back({printable(path, 400), path});
  if (!renews)
    for (const NamedFile& input : inputs) add_named_in(input.path, named);
  inputs.insert(inputs.end(), named.begin(), named.end());

  // Appended to with >>, an input grows while it is read.
  if (const auto standard_output = file_identity("/dev/stdout"))
    for (const NamedFile& input : inputs)
      if (same(standard_output, input.path))
        return usage_error("standard output would write into " + input.said +
                           ", the same file; redirect it elsewhere");

  for (auto output = outputs.begin(); output != outputs.end(); ++output) {
    const auto identity = file_identity(output->path);
    for (const NamedFile& input : inputs)
      if (same(identity, input.path))
        return usage_error(output->said + " would write over " + input.said +
                           ", the same file; give another name to write to");
    for (auto other = outputs.begin(); other != output; ++other)
      if (same(identity, other->path))
        return usage_error(other->said + " and " + output->said +
                           " are the same file; give each a name of its own");
  }
  for (const NamedFile& output : outputs) {
    // A folder that is not there yet is made when there is something to put into it.
    const fs::path parent = fs::path(output.path).parent_path();
    std::error_code none;
    const bool made_later =
        std::any_of(folders.begin(), folders.end(), [&](const std::string& folder) {
          return parent == fs::path(folder) && !fs::exists(folder, none);
        });
    if (made_later) continue;
    if (auto done = check_writable(output.path); !done) return done.error();
  }
  return Done{};
}

}  // namespace servosense::cli
