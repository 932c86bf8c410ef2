// Machine files: what is known about a machine, its tool, its cut and its monitors, as INI text
// that people edit. Comments, order and spelling survive reading and writing. The format:
// docs/files.md; sections and keys: machine_keys.hpp.
#pragma once

#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "servosense/core/expected.hpp"

namespace servosense {

class MachineFile {
 public:
  /// Larger files are refused [bytes].
  static constexpr std::size_t kLargest = std::size_t{1} << 20U;

  /// Reads and checks a file. Data error, naming file and line, for an unknown or repeated section
  /// or key and for a value of the wrong kind or beyond its plausible range, all of them, one a
  /// line; device error if the file cannot be read.
  static Expected<MachineFile> read(const std::string& path);
  /// The same from text; `name` stands for the file in error sentences.
  static Expected<MachineFile> parse(std::string_view text, std::string name);

  /// The whole file; byte for byte what was read if nothing has been set or removed.
  [[nodiscard]] std::string text() const;
  /// Checks the content as parse() does, then writes it, so that what is written can be read.
  /// Device error if the file cannot be written.
  Expected<Done> write(const std::string& path) const;

  [[nodiscard]] bool has_section(std::string_view section) const;
  /// Sections in their order.
  [[nodiscard]] std::vector<std::string> sections() const;
  [[nodiscard]] bool has(std::string_view section, std::string_view key) const;

  /// The value of a key; nothing if it is absent or of another kind.
  [[nodiscard]] std::optional<double> number(std::string_view section, std::string_view key) const;
  /// `yes` or `no`.
  [[nodiscard]] std::optional<bool> flag(std::string_view section, std::string_view key) const;
  [[nodiscard]] std::optional<std::string> text(std::string_view section,
                                                std::string_view key) const;
  /// Numbers between commas.
  [[nodiscard]] std::optional<std::vector<double>> list(std::string_view section,
                                                        std::string_view key) const;
  [[nodiscard]] std::optional<std::vector<std::array<double, 2>>> pairs(std::string_view section,
                                                                        std::string_view key) const;
  [[nodiscard]] std::optional<std::vector<std::array<double, 3>>> triples(
      std::string_view section, std::string_view key) const;
  /// number(), or a data error that says which section and key to write, and with what.
  [[nodiscard]] Expected<double> required_number(std::string_view section,
                                                 std::string_view key) const;

  /// Sets a key, in its place if it exists, else at the end of its section, which is created at the
  /// end of the file if need be. A comment that stands behind the value stays unless a new one is
  /// given. Nothing is checked here; write() does. In text, line ends and '#' become blanks: a
  /// value is one line, and '#' would begin a comment.
  void set(std::string_view section, std::string_view key, std::string_view value,
           std::string_view comment = {});
  void set(std::string_view section, std::string_view key, const char* value,
           std::string_view comment = {}) {
    set(section, key, std::string_view(value), comment);
  }
  template <typename Number>
  requires(std::integral<Number> ||
           std::floating_point<Number>) void set(std::string_view section, std::string_view key,
                                                 Number value, std::string_view comment = {}) {
    if constexpr (std::same_as<Number, bool>)
      set(section, key, std::string_view(value ? "yes" : "no"), comment);
    else
      set_number(section, key, static_cast<double>(value), comment);
  }
  void set(std::string_view section, std::string_view key, std::span<const double> values,
           std::string_view comment = {});
  void set(std::string_view section, std::string_view key,
           std::span<const std::array<double, 2>> pairs, std::string_view comment = {});
  void set(std::string_view section, std::string_view key,
           std::span<const std::array<double, 3>> triples, std::string_view comment = {});

  /// Removes a key with its line; a section without keys stays. Harmless if it is absent.
  void remove(std::string_view section, std::string_view key);
  /// Removes a section with its keys and the comments inside it.
  void remove_section(std::string_view section);

  /// "FILE:LINE" of a key, or of its section, or "FILE" if neither is there.
  [[nodiscard]] std::string where(std::string_view section, std::string_view key = {}) const;
  /// The file's path, fit for sentences.
  [[nodiscard]] const std::string& name() const { return name_; }
  /// The path of a file that this one names: beside it, unless the name is a whole path.
  [[nodiscard]] std::string beside(const std::string& named) const;

 private:
  struct Line {
    std::string raw;      // with its line end
    std::string section;  // that it stands in; "" above the first
    std::string key;      // "" for headings, comments and blank lines
    std::string value;
    bool heading = false;
  };

  [[nodiscard]] Error error_at(std::size_t index, const std::string& what) const;
  Expected<Done> add_line(std::string_view raw);
  Expected<Done> check_value(std::size_t index) const;
  Expected<Done> check_alternatives() const;
  [[nodiscard]] std::optional<std::size_t> find(std::string_view section,
                                                std::string_view key) const;
  [[nodiscard]] const std::string* value_of(std::string_view section, std::string_view key) const;
  void set_number(std::string_view section, std::string_view key, double value,
                  std::string_view comment);
  void end_last_line();

  std::string path_;  // as it was given
  std::string name_;
  std::string byte_order_mark_;
  std::string line_end_ = "\n";
  std::vector<Line> lines_;
};

}  // namespace servosense
