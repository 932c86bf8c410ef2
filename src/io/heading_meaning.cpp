#include "heading_meaning.hpp"

#include <algorithm>
#include <array>
#include <utility>

#include "servosense/io/text.hpp"

namespace servosense::detail {
namespace {

bool is_letter(char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c & 0x80); }
bool is_upper(char c) { return c >= 'A' && c <= 'Z'; }
bool is_number_char(char c) { return c >= '0' && c <= '9'; }

/// Umlauts as two letters, so that everything is ASCII that can be; superscripts stay.
std::string without_umlauts(std::string_view text) {
  constexpr auto kLetters =
      std::to_array<std::pair<std::string_view, std::string_view>>({{"\xC3\xA4", "ae"},
                                                                    {"\xC3\xB6", "oe"},
                                                                    {"\xC3\xBC", "ue"},
                                                                    {"\xC3\x84", "Ae"},
                                                                    {"\xC3\x96", "Oe"},
                                                                    {"\xC3\x9C", "Ue"},
                                                                    {"\xC3\x9F", "ss"},
                                                                    {"\xCF\x86", "phi"},
                                                                    {"\xCF\x89", "omega"},
                                                                    {"\xCF\x84", "tau"}});
  std::string out;
  while (!text.empty()) {
    const auto at = std::find_if(kLetters.begin(), kLetters.end(),
                                 [&](const auto& l) { return text.starts_with(l.first); });
    out += at == kLetters.end() ? text.substr(0, 1) : at->second;
    text.remove_prefix(at == kLetters.end() ? 1 : at->first.size());
  }
  return out;
}

/// Words in lower case and numbers, split where the spelling changes: "X1_ActualPosition".
std::vector<std::string> words_of(std::string_view name) {
  const std::string text = without_umlauts(name);
  std::vector<std::string> words;
  std::string word;
  const auto end_word = [&] {
    if (!word.empty()) words.push_back(std::exchange(word, {}));
  };
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (!is_letter(c) && !is_number_char(c)) {
      end_word();
      continue;
    }
    if (i > 0 && !word.empty()) {
      const char before = text[i - 1];
      const bool lower_before = is_letter(before) && !is_upper(before);
      const bool lower_behind = i + 1 < text.size() && text[i + 1] >= 'a' && text[i + 1] <= 'z';
      if (is_number_char(c) != is_number_char(before) || (is_upper(c) && lower_before) ||
          (is_upper(c) && is_upper(before) && lower_behind))
        end_word();
    }
    word += is_upper(c) ? static_cast<char>(c - 'A' + 'a') : c;
  }
  end_word();
  return words;
}

/// Pieces of a compound ("spindeldrehzahl", "xpos"), the fewest that make up all of it.
std::vector<std::string> pieces_of(const std::string& word) {
  if (heading_word(word) != nullptr || word.size() < 2 || word.size() > 48) return {word};
  constexpr std::size_t kNone = 99;
  const std::size_t n = word.size();
  struct Best {
    std::size_t pieces = kNone;
    std::size_t begin = 0;
    bool link = false;
  };
  std::vector<Best> best(n + 1);
  best[0].pieces = 0;
  for (std::size_t end = 1; end <= n; ++end)
    for (std::size_t begin = 0; begin < end; ++begin) {
      if (best[begin].pieces == kNone) continue;
      const std::string_view piece = std::string_view(word).substr(begin, end - begin);
      const HeadingWord* const known = heading_word(piece);
      // Single letters: an axis or a symbol at either end; German links between words.
      const bool at_end = begin == 0 || end == n;
      const bool letter = piece.size() == 1 && at_end && known != nullptr;
      const bool long_word = piece.size() >= 3 && known != nullptr;
      const bool short_word = (piece == "iq" || piece == "sp") && known != nullptr;
      const bool link = begin > 0 && end < n && !best[begin].link &&
                        (piece == "s" || piece == "en" || piece == "n" || piece == "e");
      if (!letter && !long_word && !short_word && !link) continue;
      const std::size_t pieces = best[begin].pieces + (link ? 1 : 2);
      if (pieces < best[end].pieces) best[end] = {pieces, begin, link && !letter};
    }
  if (best[n].pieces == kNone) return {word};
  std::vector<std::string> pieces;
  bool long_enough = false;
  for (std::size_t end = n; end > 0; end = best[end].begin) {
    if (best[end].link) continue;
    pieces.insert(pieces.begin(), word.substr(best[end].begin, end - best[end].begin));
    long_enough = long_enough || pieces.front().size() >= 2;
  }
  // "fx" is read as letters where it is F of x, i of x and the like.
  if (!long_enough && !(n == 2 && heading_word(word.substr(0, 1))->role == WordRole::symbol &&
                        (heading_word(word.substr(1))->role == WordRole::axis || word[1] == 's')))
    return {word};
  return pieces;
}

void add_once(std::vector<ColumnKind>& kinds, ColumnKind kind) {
  if (std::find(kinds.begin(), kinds.end(), kind) == kinds.end()) kinds.push_back(kind);
}

/// Collects what the words say.
class WordReader {
 public:
  explicit WordReader(std::string_view name) {
    for (const std::string& word : words_of(name))
      for (std::string& piece : pieces_of(word)) words_.push_back(std::move(piece));
    // "I_q", "I d": one word of two letters.
    for (std::size_t i = 0; i + 1 < words_.size(); ++i)
      if (words_[i] == "i" && (words_[i + 1] == "q" || words_[i + 1] == "d")) {
        words_[i] += words_[i + 1];
        words_.erase(words_.begin() + static_cast<std::ptrdiff_t>(i) + 1);
      }
    for (at_ = 0; at_ < words_.size(); ++at_) take(words_[at_]);
    finish();
  }
  [[nodiscard]] HeadingMeaning take_meaning() { return std::move(m_); }

 private:
  [[nodiscard]] std::string number_behind() const {
    return at_ + 1 < words_.size() && is_number_char(words_[at_ + 1][0]) ? words_[at_ + 1] : "";
  }

  void take(const std::string& word) {
    const HeadingWord* const known = heading_word(word);
    if (known == nullptr) {
      m_.unknown.push_back(word);
      return;
    }
    switch (known->role) {
      case WordRole::spindle:
      case WordRole::axis:
        take_channel(*known);
        break;
      case WordRole::second:
        second_ = true;
        break;
      case WordRole::dyno:
        special_ = static_cast<Channel>(known->value);
        break;
      case WordRole::kind:
        add_once(m_.kinds, static_cast<ColumnKind>(known->value));
        break;
      case WordRole::current_:
        says_current_ = true;
        break;
      case WordRole::symbol:
        symbols_.push_back(*known);
        break;
      case WordRole::command:
        m_.command = true;
        break;
      case WordRole::actual:
        m_.actual = true;
        break;
      case WordRole::statistic:
        m_.statistic = true;
        break;
      case WordRole::numbered:
        m_.says_axis = true;
        if (const std::string n = number_behind(); !n.empty()) {
          numbered_ = word + " " + n;
          ++at_;
        }
        break;
      case WordRole::counted:
        if (!number_behind().empty()) ++at_;
        break;
      case WordRole::number:
        number_ = word;
        break;
      case WordRole::other:
        if (m_.left_out.empty()) m_.left_out = word;
        break;
      case WordRole::neutral:
        break;
    }
  }

  void take_channel(const HeadingWord& word) {
    Drive drive{std::string(word.text), word.role == WordRole::spindle,
                word.role == WordRole::axis ? static_cast<Channel>(word.value) : Channel::spindle,
                ""};
    if (const std::string n = number_behind(); !n.empty()) {
      drive.number = n;
      ++at_;
    }
    drives_.push_back(drive);
  }

  void finish() {
    // A single s beside another drive is a path, a single a beside one an acceleration.
    if (drives_.size() > 1) drop_letter("s", ColumnKind::position);
    if (drives_.size() > 1) drop_letter("a", ColumnKind::acceleration);
    for (const Drive& drive : drives_) add_drive(drive);
    if (second_ && m_.channel == Channel::spindle) m_.channel = Channel::spindle2;
    if (second_ && !m_.channel) m_.unknown.emplace_back("second");
    if (!m_.channel && m_.channel_doubt.empty()) m_.channel_doubt = numbered_;
    if (special_) {
      m_.direction = m_.channel;
      m_.channel = special_;
    }
    if (says_current_) {
      // "Current position": of now.
      const bool of_now = std::any_of(m_.kinds.begin(), m_.kinds.end(), [](ColumnKind kind) {
        return kind == ColumnKind::position || kind == ColumnKind::speed ||
               kind == ColumnKind::rotation || kind == ColumnKind::block ||
               kind == ColumnKind::override_ || kind == ColumnKind::temperature ||
               kind == ColumnKind::time || kind == ColumnKind::voltage;
      });
      if (of_now)
        m_.actual = true;
      else
        add_once(m_.kinds, ColumnKind::current);
    }
    const bool block =
        std::find(m_.kinds.begin(), m_.kinds.end(), ColumnKind::block) != m_.kinds.end();
    if (!number_.empty() && !block && m_.left_out.empty()) m_.left_out = number_;
    const bool override_ =
        std::find(m_.kinds.begin(), m_.kinds.end(), ColumnKind::override_) != m_.kinds.end();
    if (override_ && m_.left_out == "feedrate") m_.left_out.clear();
    if (block)  // "M1_sequence_number"
      std::erase_if(m_.unknown, [](const std::string& word) { return is_number_char(word[0]); });
    for (const HeadingWord& symbol : symbols_)
      m_.symbols.push_back(static_cast<ColumnKind>(symbol.value));
    // With a word for the quantity, letters are decoration ("Strom I") or of its kind.
    if (!m_.kinds.empty()) {
      for (const HeadingWord& symbol : symbols_) {
        const auto kind = static_cast<ColumnKind>(symbol.value);
        const bool same = std::find(m_.kinds.begin(), m_.kinds.end(), kind) != m_.kinds.end();
        // The M of a machine's own data ("M1_...") and the N of block numbers.
        if (!same && !(block && (symbol.text == "n" || symbol.text == "m")))
          m_.unknown.emplace_back(symbol.text);
      }
      m_.symbols.clear();
    }
  }

  struct Drive {
    std::string text;
    bool turns = false;
    Channel channel = Channel::spindle;
    std::string number;
  };
  void drop_letter(std::string_view letter, ColumnKind kind) {
    const auto at = std::find_if(drives_.begin(), drives_.end(), [&](const Drive& d) {
      return d.text == letter && d.number.empty();
    });
    if (at == drives_.end()) return;
    const bool others = std::any_of(drives_.begin(), drives_.end(),
                                    [&](const Drive& d) { return d.text != letter; });
    if (!others) return;
    m_.symbols.push_back(kind);
    drives_.erase(at);
  }
  void add_drive(const Drive& drive) {
    Channel channel = drive.channel;
    if (drive.turns && drive.number == "2") channel = Channel::spindle2;
    const bool plain = drive.number.empty() || drive.number == "1" ||
                       (drive.turns && (drive.number == "2" || drive.number == "0"));
    if (!plain) m_.channel_doubt = drive.text + drive.number;
    if (m_.channel && *m_.channel != channel)
      m_.channel_doubt =
          std::string(name_of(*m_.channel)) + " and " + std::string(name_of(channel));
    if (!m_.channel) m_.channel = channel;
  }

  HeadingMeaning m_;
  std::vector<std::string> words_;
  std::vector<Drive> drives_;
  std::vector<HeadingWord> symbols_;
  std::size_t at_ = 0;
  bool second_ = false, says_current_ = false;
  std::optional<Channel> special_;
  std::string numbered_, number_;
};

HeadingMeaning read_words(std::string_view name) { return WordReader(name).take_meaning(); }

bool fits_name(std::string_view name, const UnitName& unit, bool in_brackets = false) {
  const HeadingMeaning m = read_words(name);
  std::vector<ColumnKind> kinds = m.kinds;
  kinds.insert(kinds.end(), m.symbols.begin(), m.symbols.end());
  // A letter that could also be an axis or a spindle needs a quantity that has that unit.
  if (kinds.empty()) return in_brackets || unit.spelling.size() > 1;
  return std::any_of(kinds.begin(), kinds.end(),
                     [&](ColumnKind kind) { return kind_fits(kind, unit.dimension); });
}

/// The unit among the kinds of the name where case does not tell ("[NM]", "[nm]" of a torque).
std::optional<UnitName> unit_for(std::string_view name, std::string_view text) {
  const auto plain = unit_named(text);
  if (plain && fits_name(name, *plain)) return plain;
  for (const ColumnKind kind : read_words(name).kinds)
    for (int d = 0; d <= static_cast<int>(Dimension::counts); ++d)
      if (kind_fits(kind, static_cast<Dimension>(d)))
        if (const auto unit = unit_named(text, static_cast<Dimension>(d))) return unit;
  return plain;
}

struct NameAndUnit {
  std::string name, unit;
  std::optional<UnitName> known;
};

/// "Spindle speed [1/min]", "I_q (A)".
std::optional<NameAndUnit> unit_in_brackets(std::string_view heading) {
  std::optional<NameAndUnit> unknown;
  constexpr std::string_view kOpen = "[({<", kClose = "])}>";
  for (std::size_t close = heading.size(); close-- > 0;) {
    const std::size_t which = kClose.find(heading[close]);
    if (which == std::string_view::npos) continue;
    const std::size_t open = heading.substr(0, close).rfind(kOpen[which]);
    if (open == std::string_view::npos) continue;
    const std::string_view content = trim(heading.substr(open + 1, close - open - 1));
    const std::string name = std::string(trim(heading.substr(0, open))) +
                             (close + 1 < heading.size() ? " " : "") +
                             std::string(trim(heading.substr(close + 1)));
    const auto unit = unit_for(name, content);
    const HeadingMeaning words = read_words(content);
    const bool is_name = words.unknown.empty() && !words_of(content).empty();
    if (unit && (!is_name || fits_name(name, *unit, true)))
      return NameAndUnit{name, std::string(content), unit};
    if (!content.empty() && content != "-" && content != "1" && !is_name && !unknown)
      unknown = NameAndUnit{name, std::string(content), std::nullopt};
    close = open;
    if (open == 0) break;
  }
  return unknown;
}

/// "Strom/A", "pos_mm", "vel_deg_s", "Zeit in ms", "n 1/min".
std::optional<NameAndUnit> unit_behind(std::string_view heading) {
  constexpr std::string_view kMarks = "/ _,:";
  for (std::size_t i = 1; i + 1 < heading.size(); ++i) {
    if (kMarks.find(heading[i]) == std::string_view::npos) continue;
    std::string_view rest = trim(heading.substr(i + 1));
    const std::string name(trim(heading.substr(0, i)));
    for (const std::string_view before : {"in ", "/ ", "in_"})
      if (rest.starts_with(before)) rest = trim(rest.substr(before.size()));
    if (rest.size() > 1 && rest.front() == '(' && rest.back() == ')')
      rest = rest.substr(1, rest.size() - 2);
    std::string spelled(rest);
    for (const std::string_view per : {" per ", "_per_", "_"})
      if (const std::size_t at = spelled.find(per); at != std::string::npos)
        spelled.replace(at, per.size(), "/");
    for (const std::string& text : {std::string(rest), spelled}) {
      auto unit = text.size() == 1 ? unit_named(text) : unit_for(name, text);
      // One letter in the wrong case is a name.
      if (unit && text.size() == 1 && unit->spelling != text) unit.reset();
      if (unit && fits_name(name, *unit)) return NameAndUnit{name, std::string(rest), unit};
    }
  }
  return std::nullopt;
}

}  // namespace

HeadingMeaning meaning_of(std::string_view heading, std::string_view unit_line) {
  std::string flat(heading);
  std::replace(flat.begin(), flat.end(), '\n', ' ');
  NameAndUnit parts{flat, "", std::nullopt};
  if (auto in_brackets = unit_in_brackets(flat))
    parts = *in_brackets;
  else if (auto behind = unit_behind(flat))
    parts = *behind;
  if (parts.unit.empty() && !unit_line.empty() && unit_line != "-") {
    parts.unit = std::string(unit_line);
    parts.known = unit_for(parts.name, unit_line);
  }
  HeadingMeaning m = read_words(parts.name);
  m.name = parts.name;
  // "Spindle rpm" names its unit.
  if (parts.unit.empty())
    for (const std::string& word : words_of(parts.name))
      if (word == "rpm") {
        parts.unit = "rpm";
        parts.known = unit_named("rpm");
      }
  m.unit = parts.unit;
  m.known_unit = parts.known;
  return m;
}

}  // namespace servosense::detail
