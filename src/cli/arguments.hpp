// Command-line options: declared once, parsed, checked and explained from the same table.
#pragma once

#include <map>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "servosense/core/expected.hpp"

namespace servosense::cli {

/// What a command does with the file that an option names; check_outputs() asks for it.
enum class FileUse {
  none,     ///< no file
  input,    ///< read
  output,   ///< written
  renewed,  ///< written, and may be what the machine file names: it is made anew
  reread,   ///< read more than once, so no pipe
  folder    ///< written into: the files are Option::in_folder
};

struct Option {
  std::string name;     ///< "--machine"
  std::string value;    ///< "FILE"; empty for a switch
  std::string meaning;  ///< one line
  bool required = false;
  FileUse use = FileUse::none;
  std::vector<std::string> in_folder = {};
  bool repeated = false;  ///< may be given more than once
};

struct Command {
  std::string name;     ///< "monitor", "identify idle"
  std::string summary;  ///< one line
  std::vector<Option> options;
  std::string operands;  ///< "EVENTS..." when the command takes any: files that it reads
  std::string notes;     ///< further text for --help
};

/// Options that every command has.
const std::vector<Option>& common_options();

/// What a user typed, checked against the command's options.
class Arguments {
 public:
  /// Usage error naming the nearest option for what is not known, or what is missing.
  static Expected<Arguments> parse(const Command& command, std::span<const std::string> words);

  [[nodiscard]] bool has(const std::string& name) const { return values_.contains(name); }
  [[nodiscard]] std::optional<std::string> value(const std::string& name) const;
  /// All values of an option that may be repeated.
  [[nodiscard]] std::vector<std::string> all(const std::string& name) const;
  /// Value of a required option.
  [[nodiscard]] const std::string& at(const std::string& name) const { return values_.at(name); }
  /// Positive number of an option; nothing when it was not given.
  [[nodiscard]] Expected<std::optional<double>> positive(const std::string& name) const;
  /// The same between two bounds, whose `unit` the sentence names.
  [[nodiscard]] Expected<std::optional<double>> within(const std::string& name, double least,
                                                       double greatest,
                                                       const std::string& unit = "") const;
  [[nodiscard]] const std::vector<std::string>& operands() const { return operands_; }
  [[nodiscard]] bool help() const { return has("--help"); }
  [[nodiscard]] bool json() const { return has("--json"); }
  [[nodiscard]] bool quiet() const { return has("--quiet"); }

 private:
  std::map<std::string, std::string> values_;  // of a repeated one, the last
  std::vector<std::pair<std::string, std::string>> repeated_;
  std::vector<std::string> operands_;
};

}  // namespace servosense::cli
