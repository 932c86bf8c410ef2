#include "arguments.hpp"

#include "servosense/io/text.hpp"

namespace servosense::cli {

const std::vector<Option>& common_options() {
  static const std::vector<Option> options = {
      {"--json", "", "print one JSON object on standard output and nothing else there", false},
      {"--quiet", "", "no progress and no remarks on standard error", false},
      {"--help", "", "this text; -h does the same", false}};
  return options;
}

namespace {

const Option* find(const Command& command, const std::string& name) {
  for (const std::vector<Option>* options : {&command.options, &common_options()})
    for (const Option& option : *options)
      if (option.name == name) return &option;
  return nullptr;
}

std::string hint(const Command& command) {
  return "; see 'servosense " + command.name + " --help'";
}

}  // namespace

Expected<Arguments> Arguments::parse(const Command& command, std::span<const std::string> words) {
  Arguments arguments;
  for (std::size_t i = 0; i < words.size(); ++i) {
    const std::string word = words[i] == "-h" ? "--help" : words[i];
    if (!word.starts_with("--") || word == "-") {
      if (command.operands.empty())
        return usage_error("'" + word + "' is not expected here" + hint(command));
      arguments.operands_.push_back(word);
      continue;
    }
    const Option* option = find(command, word);
    if (option == nullptr) {
      std::vector<std::string_view> names;
      for (const Option& o : command.options) names.push_back(o.name);
      for (const Option& o : common_options()) names.push_back(o.name);
      return usage_error("servosense " + command.name + " has no option '" + word +
                         "'; did you mean '" + std::string(nearest_name(word, names)) + "'?");
    }
    if (arguments.has(word) && !option->repeated)
      return usage_error("'" + word + "' is given twice" + hint(command));
    std::string value;
    if (!option->value.empty()) {
      if (i + 1 == words.size() || words[i + 1].starts_with("--"))
        return usage_error("'" + word + "' needs a value (" + option->value + ")" + hint(command));
      value = words[++i];
      if (value.empty())
        return usage_error("'" + word + "' needs a value (" + option->value + ")" + hint(command));
      if (value == "-" && option->use != FileUse::none && !option->value.ends_with("|-"))
        return usage_error("'" + word +
                           " -': no file is called that; name one, or /dev/stdin or /dev/stdout");
    }
    arguments.values_[word] = value;
    if (option->repeated) arguments.repeated_.emplace_back(word, value);
  }
  if (arguments.help()) return arguments;
  for (const Option& option : command.options)
    if (option.required && !arguments.has(option.name))
      return usage_error("servosense " + command.name + " needs " + option.name + " " +
                         option.value + hint(command));
  return arguments;
}

std::optional<std::string> Arguments::value(const std::string& name) const {
  const auto at = values_.find(name);
  if (at == values_.end()) return std::nullopt;
  return at->second;
}

std::vector<std::string> Arguments::all(const std::string& name) const {
  std::vector<std::string> values;
  for (const auto& [option, value] : repeated_)
    if (option == name) values.push_back(value);
  return values;
}

Expected<std::optional<double>> Arguments::positive(const std::string& name) const {
  const auto text = value(name);
  if (!text) return std::optional<double>{};
  const auto number = parse_number(*text);
  if (!number.ok() || !(number.value > 0))
    return usage_error(name + " takes a positive number, not '" + *text + "'");
  return std::optional<double>{number.value};
}

Expected<std::optional<double>> Arguments::within(const std::string& name, double least,
                                                  double greatest, const std::string& unit) const {
  auto number = positive(name);
  if (number && *number && !(**number >= least && **number <= greatest))
    return usage_error(name + " takes a number from " + number_text(least) + " to " +
                       number_text(greatest) + unit + ", not '" + *value(name) + "'");
  return number;
}

}  // namespace servosense::cli
