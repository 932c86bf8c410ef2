#include "servosense/io/machine_file.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <set>
#include <utility>

#include "byte_order_mark.hpp"
#include "servosense/io/line_reader.hpp"
#include "servosense/io/machine_keys.hpp"
#include "servosense/io/text.hpp"
#include "servosense/io/write_file.hpp"

namespace servosense {
namespace {

constexpr auto kAlternatives = std::to_array<KeyAlternatives>({
    {"axis.", "torque_constant_Nm_per_A", "force_constant_N_per_A"},
    {"structure.", "modes", "frf"},
});

std::string_view without_line_end(std::string_view raw) {
  if (raw.ends_with('\n')) raw.remove_suffix(1);
  if (raw.ends_with('\r')) raw.remove_suffix(1);
  return raw;
}

/// The part of a line before its comment, blanks at the ends taken off.
std::string_view before_comment(std::string_view line) {
  return trim(line.substr(0, line.find('#')));
}

std::vector<std::string_view> split(std::string_view text, std::string_view separators,
                                    bool keep_empty) {
  std::vector<std::string_view> parts;
  for (;;) {
    const std::size_t at = text.find_first_of(separators);
    const std::string_view part = trim(text.substr(0, at));
    if (keep_empty || !part.empty()) parts.push_back(part);
    if (at == std::string_view::npos) return parts;
    text.remove_prefix(at + 1);
  }
}

/// Tuples of N numbers between blanks, a comma between tuples; nothing if the text is not that.
template <std::size_t N>
std::optional<std::vector<std::array<double, N>>> parse_tuples(std::string_view text) {
  std::vector<std::array<double, N>> tuples;
  for (const std::string_view part : split(text, ",", true)) {
    const std::vector<std::string_view> words = split(part, " \t", false);
    if (words.size() != N) return std::nullopt;
    std::array<double, N> tuple{};
    for (std::size_t i = 0; i < N; ++i) {
      const ParsedNumber<double> number = parse_number(words[i]);
      if (!number.ok()) return std::nullopt;
      tuple[i] = number.value;
    }
    tuples.push_back(tuple);
  }
  return tuples;
}

template <std::size_t N>
std::string tuples_text(std::span<const std::array<double, N>> tuples) {
  std::string out;
  for (const auto& tuple : tuples) {
    if (!out.empty()) out += ", ";
    for (std::size_t i = 0; i < N; ++i) {
      if (i > 0) out += ' ';
      append_number(out, tuple[i]);
    }
  }
  return out;
}

template <std::size_t N>
bool within_ranges(std::string_view text, const MachineKey& key) {
  const auto tuples = parse_tuples<N>(text);
  if (!tuples || tuples->size() < key.count.fewest || tuples->size() > key.count.most) return false;
  const std::array<const KeyRange*, 3> ranges = {&key.range, &key.second, &key.third};
  for (const auto& tuple : *tuples)
    for (std::size_t i = 0; i < N; ++i)
      if (!ranges[i]->holds(tuple[i])) return false;
  return true;
}

bool acceptable(std::string_view value, const MachineKey& key) {
  switch (key.kind) {
    case KeyKind::number:
    case KeyKind::integer: {
      const ParsedNumber<double> number = parse_number(value);
      return number.ok() && key.range.holds(number.value) &&
             (key.kind == KeyKind::number || number.value == std::floor(number.value));
    }
    case KeyKind::flag:
      return value == "yes" || value == "no";
    case KeyKind::word: {
      const auto choices = split(key.choices, " ", false);
      return std::find(choices.begin(), choices.end(), value) != choices.end();
    }
    case KeyKind::text:
      return is_shown_as_written(value);
    case KeyKind::list:
      return within_ranges<1>(value, key);
    case KeyKind::pairs:
      return within_ranges<2>(value, key);
    case KeyKind::triples:
      return within_ranges<3>(value, key);
  }
  return false;
}

/// Why a bare number may still be wrong, in the words that help most.
std::string remedy(std::string_view value, const MachineKey& key) {
  const bool numeric = key.kind == KeyKind::number || key.kind == KeyKind::integer;
  const ParsedNumber<double> number = parse_number(value);
  if (numeric && number.ok() && !key.range.holds(number.value))
    return number.value < 0 && key.range.low >= 0 ? "check the sign" : "check the unit";
  if (numeric && value.find(',') != std::string_view::npos)
    return "write one number with a decimal point";
  if (key.kind == KeyKind::word) {
    const auto choices = split(key.choices, " ", false);
    return "the nearest is '" + std::string(nearest_name(value, choices)) + "'";
  }
  if (key.kind == KeyKind::text) return "save the file as UTF-8, without control characters";
  return "correct the value or remove the line";
}

constexpr std::size_t kMostFaults = 20;  // that are told at once

/// One a line.
std::string as_lines(const std::vector<std::string>& faults) {
  std::string text;
  for (std::size_t i = 0; i < std::min(faults.size(), kMostFaults); ++i)
    text += (i > 0 ? "\n" : "") + faults[i];
  if (faults.size() > kMostFaults)
    text += "\nand " + std::to_string(faults.size() - kMostFaults) + " more of the kind";
  return text;
}

}  // namespace

std::span<const KeyAlternatives> key_alternatives() { return kAlternatives; }

std::string value_fault(const MachineKey& key, std::string_view value) {
  if (acceptable(value, key)) return {};
  return "expected " + expectation(key) + ", found " + in_quotes(value) + "; " + remedy(value, key);
}

// ---------------------------------------------------------------------------------------- reading

Expected<MachineFile> MachineFile::read(const std::string& path) {
  Expected<std::unique_ptr<std::istream>> file = open_for_reading(path);
  if (!file) return file.error();
  std::string text(kLargest + 1, '\0');
  (*file)->read(text.data(), static_cast<std::streamsize>(text.size()));
  if ((*file)->bad())
    return device_error(printable(path, 400) +
                        ": reading failed; check the disk or the connection");
  text.resize(static_cast<std::size_t>((*file)->gcount()));
  return parse(text, path);
}

Expected<MachineFile> MachineFile::parse(std::string_view text, std::string name) {
  MachineFile file;
  file.name_ = printable(name, 400);
  file.path_ = std::move(name);
  if (text.size() > kLargest)
    return data_error(file.name_ + ":1: the file is larger than 1 MiB; give a machine file");
  if (text.starts_with(kByteOrderMark)) {
    file.byte_order_mark_ = kByteOrderMark;
    text.remove_prefix(kByteOrderMark.size());
  }
  std::map<std::string, std::size_t, std::less<>> sections;  // line of each
  std::set<std::pair<std::string_view, std::string_view>> keys;
  std::vector<std::string> faults;
  bool known_section = true;  // else its keys are not judged
  while (!text.empty()) {
    const std::size_t length = std::min(text.find('\n'), text.size() - 1) + 1;
    const std::string_view raw = text.substr(0, length);
    text.remove_prefix(length);
    const std::size_t index = file.lines_.size();
    if (raw.find('\0') != std::string_view::npos)
      return file.error_at(index,
                           "the file holds NUL bytes, so it is binary or UTF-16; give UTF-8 text");
    if (index == 0 && raw.ends_with("\r\n")) file.line_end_ = "\r\n";
    const bool heading = before_comment(without_line_end(raw)).starts_with('[');
    if (heading) known_section = true;
    const auto pass_over = [&] {
      file.lines_.push_back(
          {std::string(raw), index > 0 ? file.lines_.back().section : "", {}, {}, false});
    };
    const auto fault = [&](const Error& error) {
      faults.push_back(error.sentence);
      if (heading) known_section = false;
      if (file.lines_.size() == index) pass_over();
    };
    if (!known_section) {
      pass_over();
      continue;
    }
    if (const Expected<Done> added = file.add_line(raw); !added) {
      fault(added.error());
      continue;
    }
    const Line& line = file.lines_.back();
    if (line.heading) {
      const auto [twin, is_new] = sections.emplace(line.section, index);
      if (!is_new)
        fault(file.error_at(index, "section " + in_quotes("[" + line.section + "]") +
                                       " begins on line " + std::to_string(twin->second + 1) +
                                       " already; put its keys there"));
    } else if (!line.key.empty()) {
      // The table's names outlive the vector of lines, which moves as it grows.
      const MachineKey* const known = find_machine_key(line.section, line.key);
      const auto section = sections.find(line.section);
      if (!keys.emplace(section->first, known->name).second)
        fault(file.error_at(index, in_quotes(line.key) + " in [" + line.section +
                                       "] is given on line " +
                                       std::to_string(*file.find(line.section, line.key) + 1) +
                                       " already; remove one of them"));
      else if (const Expected<Done> checked = file.check_value(index); !checked)
        fault(checked.error());
    }
  }
  if (const Expected<Done> checked = file.check_alternatives(); !checked)
    faults.push_back(checked.error().sentence);
  if (!faults.empty()) return data_error(as_lines(faults));
  return file;
}

Error MachineFile::error_at(std::size_t index, const std::string& what) const {
  return data_error(name_ + ":" + std::to_string(index + 1) + ": " + what);
}

/// Takes one line apart and appends it; an error if it does not belong into a machine file.
Expected<Done> MachineFile::add_line(std::string_view raw) {
  const std::size_t index = lines_.size();
  Line line;
  line.raw = raw;
  if (!lines_.empty()) line.section = lines_.back().section;
  const std::string_view content = before_comment(without_line_end(raw));
  if (content.starts_with('[')) {
    if (!content.ends_with(']'))
      return error_at(index, "expected [section], found " + in_quotes(content) +
                                 "; close the bracket and put nothing behind it");
    line.section = trim(content.substr(1, content.size() - 2));
    line.heading = true;
    if (section_families(line.section).empty())
      return error_at(index, "unknown section " + in_quotes("[" + line.section + "]") +
                                 "; the nearest known one is [" + nearest_section(line.section) +
                                 "]");
  } else if (!content.empty()) {
    const std::size_t equals = content.find('=');
    if (equals == std::string_view::npos)
      return error_at(index, "expected key = value, found " + in_quotes(content) +
                                 "; put an equals sign, or # before a comment");
    line.key = trim(content.substr(0, equals));
    line.value = trim(content.substr(equals + 1));
    if (line.section.empty())
      return error_at(index,
                      "key " + in_quotes(line.key) +
                          " stands above the first section; put it under one, like [spindle]");
    if (find_machine_key(line.section, line.key) == nullptr) {
      const std::string nearest = nearest_key(line.section, line.key);
      return error_at(index, "unknown key " + in_quotes(line.key) + " in [" + line.section +
                                 "]; the nearest known one is '" + nearest + "'");
    }
  }
  lines_.push_back(std::move(line));
  return Done{};
}

Expected<Done> MachineFile::check_value(std::size_t index) const {
  const Line& line = lines_[index];
  const MachineKey& known = *find_machine_key(line.section, line.key);
  if (line.value.empty())
    return error_at(index, in_quotes(line.key) + " has no value; expected " + expectation(known) +
                               ", or remove the line");
  const std::string fault = value_fault(known, line.value);
  if (fault.empty()) return Done{};
  return error_at(index, in_quotes(line.key) + ": " + fault);
}

Expected<Done> MachineFile::check_alternatives() const {
  for (const KeyAlternatives& either : kAlternatives)
    for (const std::string& section : sections()) {
      if (!section.starts_with(either.prefix)) continue;
      const auto first = find(section, either.first);
      const auto second = find(section, either.second);
      if (!first || !second) continue;
      return error_at(std::max(*first, *second),
                      "[" + section + "] has both '" + std::string(either.first) + "' and '" +
                          std::string(either.second) + "' (line " +
                          std::to_string(std::min(*first, *second) + 1) +
                          "), which may contradict each other; keep one");
    }
  return Done{};
}

// ----------------------------------------------------------------------------------------- asking

std::string MachineFile::text() const {
  std::string out = byte_order_mark_;
  for (const Line& line : lines_) out += line.raw;
  return out;
}

std::string MachineFile::beside(const std::string& named) const {
  return (std::filesystem::path(path_).parent_path() / named).string();
}

bool MachineFile::has_section(std::string_view section) const {
  return std::any_of(lines_.begin(), lines_.end(),
                     [&](const Line& line) { return line.heading && line.section == section; });
}

std::vector<std::string> MachineFile::sections() const {
  std::vector<std::string> names;
  for (const Line& line : lines_)
    if (line.heading) names.push_back(line.section);
  return names;
}

std::optional<std::size_t> MachineFile::find(std::string_view section, std::string_view key) const {
  for (std::size_t i = 0; i < lines_.size(); ++i)
    if (!lines_[i].key.empty() && lines_[i].key == key && lines_[i].section == section) return i;
  return std::nullopt;
}

const std::string* MachineFile::value_of(std::string_view section, std::string_view key) const {
  const auto index = find(section, key);
  return index ? &lines_[*index].value : nullptr;
}

bool MachineFile::has(std::string_view section, std::string_view key) const {
  return find(section, key).has_value();
}

std::optional<double> MachineFile::number(std::string_view section, std::string_view key) const {
  const std::string* const value = value_of(section, key);
  if (value == nullptr) return std::nullopt;
  const ParsedNumber<double> number = parse_number(*value);
  return number.ok() ? std::optional(number.value) : std::nullopt;
}

std::optional<bool> MachineFile::flag(std::string_view section, std::string_view key) const {
  const std::string* const value = value_of(section, key);
  if (value == nullptr || (*value != "yes" && *value != "no")) return std::nullopt;
  return *value == "yes";
}

std::optional<std::string> MachineFile::text(std::string_view section, std::string_view key) const {
  const std::string* const value = value_of(section, key);
  return value ? std::optional(*value) : std::nullopt;
}

std::optional<std::vector<double>> MachineFile::list(std::string_view section,
                                                     std::string_view key) const {
  const std::string* const value = value_of(section, key);
  if (value == nullptr) return std::nullopt;
  const auto tuples = parse_tuples<1>(*value);
  if (!tuples) return std::nullopt;
  std::vector<double> numbers;
  for (const auto& tuple : *tuples) numbers.push_back(tuple[0]);
  return numbers;
}

std::optional<std::vector<std::array<double, 2>>> MachineFile::pairs(std::string_view section,
                                                                     std::string_view key) const {
  const std::string* const value = value_of(section, key);
  return value ? parse_tuples<2>(*value) : std::nullopt;
}

std::optional<std::vector<std::array<double, 3>>> MachineFile::triples(std::string_view section,
                                                                       std::string_view key) const {
  const std::string* const value = value_of(section, key);
  return value ? parse_tuples<3>(*value) : std::nullopt;
}

Expected<double> MachineFile::required_number(std::string_view section,
                                              std::string_view key) const {
  if (const auto value = number(section, key)) return *value;
  const MachineKey* const known = find_machine_key(section, key);
  const std::string what =
      known ? std::string(known->meaning) + ", " + expectation(*known) : std::string("a number");
  return data_error(where(section, key) + ": " +
                    (has(section, key) ? "'" + std::string(key) + "' is not one number"
                     : has_section(section)
                         ? "[" + std::string(section) + "] has no '" + std::string(key) + "'"
                         : "there is no section [" + std::string(section) + "]") +
                    "; write '" + std::string(key) + " = ...' under [" + std::string(section) +
                    "] (" + what + ")");
}

std::string MachineFile::where(std::string_view section, std::string_view key) const {
  if (const auto index = find(section, key)) return name_ + ":" + std::to_string(*index + 1);
  for (std::size_t i = 0; i < lines_.size(); ++i)
    if (lines_[i].heading && lines_[i].section == section)
      return name_ + ":" + std::to_string(i + 1);
  return name_;
}

// --------------------------------------------------------------------------------------- changing

void MachineFile::end_last_line() {
  if (lines_.empty() || lines_.back().raw.ends_with('\n')) return;
  lines_.back().raw += lines_.back().raw.ends_with('\r') ? "\n" : line_end_;
}

void MachineFile::set(std::string_view section, std::string_view key, std::string_view value,
                      std::string_view comment) {
  const auto one_line = [](std::string_view text, bool is_value) {
    std::string out(text);
    for (char& c : out)
      if (static_cast<unsigned char>(c) < 0x20 || (is_value && c == '#')) c = ' ';
    out = std::string(trim(out));
    // What parse() would refuse is spelt out.
    return is_shown_as_written(out) ? out : printable(out, std::string::npos);
  };
  Line line;
  line.section = section;
  line.key = key;
  line.value = one_line(value, true);
  std::string tail = comment.empty() ? "" : "  # " + one_line(comment, false);

  if (const auto index = find(section, key)) {
    Line& old = lines_[*index];
    const std::string_view content = without_line_end(old.raw);
    const std::string_view end = std::string_view(old.raw).substr(content.size());
    // Everything up to the value stays as it was typed.
    const std::size_t equals = content.find('=');
    const std::size_t start =
        std::min(content.find_first_not_of(" \t", equals + 1), content.size());
    const std::size_t hash = std::min(content.find('#'), content.size());
    std::string head(content.substr(0, std::min(start, hash)));
    if (old.value.empty()) head += ' ';
    if (tail.empty() && hash < content.size()) {
      const std::size_t value_end = content.find_last_not_of(" \t", hash - 1) + 1;
      tail = content.substr(value_end);
    }
    old.raw = head + line.value + tail + std::string(end);
    old.value = line.value;
    return;
  }

  line.raw = std::string(key) + " = " + line.value + tail + line_end_;
  end_last_line();
  if (!has_section(section)) {
    const auto blank = [](const Line& l) { return trim(without_line_end(l.raw)).empty(); };
    const std::string above = lines_.empty() ? "" : lines_.back().section;
    if (!lines_.empty() && !blank(lines_.back()))
      lines_.push_back({line_end_, above, "", "", false});
    lines_.push_back({"[" + std::string(section) + "]" + line_end_, line.section, "", "", true});
    lines_.push_back(std::move(line));
    return;
  }
  // Behind the last key of the section, above the comments that lead to the next one.
  std::size_t at = 0;
  for (std::size_t i = 0; i < lines_.size(); ++i)
    if (lines_[i].section == section && (lines_[i].heading || !lines_[i].key.empty())) at = i + 1;
  lines_.insert(lines_.begin() + static_cast<std::ptrdiff_t>(at), std::move(line));
}

void MachineFile::set_number(std::string_view section, std::string_view key, double value,
                             std::string_view comment) {
  set(section, key, std::string_view(number_text(value)), comment);
}

void MachineFile::set(std::string_view section, std::string_view key,
                      std::span<const double> values, std::string_view comment) {
  std::string out;
  for (const double value : values) {
    if (!out.empty()) out += ", ";
    append_number(out, value);
  }
  set(section, key, std::string_view(out), comment);
}

void MachineFile::set(std::string_view section, std::string_view key,
                      std::span<const std::array<double, 2>> pairs, std::string_view comment) {
  set(section, key, std::string_view(tuples_text<2>(pairs)), comment);
}

void MachineFile::set(std::string_view section, std::string_view key,
                      std::span<const std::array<double, 3>> triples, std::string_view comment) {
  set(section, key, std::string_view(tuples_text<3>(triples)), comment);
}

void MachineFile::remove(std::string_view section, std::string_view key) {
  if (const auto index = find(section, key))
    lines_.erase(lines_.begin() + static_cast<std::ptrdiff_t>(*index));
}

void MachineFile::remove_section(std::string_view section) {
  std::erase_if(lines_,
                [&](const Line& line) { return !line.section.empty() && line.section == section; });
}

Expected<Done> MachineFile::write(const std::string& path) const {
  const std::string content = text();
  const Expected<MachineFile> checked = parse(content, path);
  if (!checked) return checked.error();
  return write_file(path, content);
}

}  // namespace servosense
