#include "servosense/hal/dbc.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <map>
#include <set>
#include <utility>

#include "dbc_lexer.hpp"
#include "servosense/io/can_frame.hpp"
#include "servosense/io/line_reader.hpp"
#include "servosense/io/text.hpp"

namespace servosense {
namespace {

using dbc::Lexer;
using dbc::Token;

constexpr std::uint32_t kExtended = 1U << 31U;
constexpr std::uint32_t kIndependentSignals = 0xC0000000;  // Vector's heap of signals without frame

// Sections that end with a semicolon and do not say where a number lies.
constexpr std::array<std::string_view, 27> kPassedOver = {"BA_",
                                                          "BA_DEF_",
                                                          "BA_DEF_DEF_",
                                                          "BA_DEF_DEF_REL_",
                                                          "BA_DEF_REL_",
                                                          "BA_REL_",
                                                          "BA_DEF_SGTYPE_",
                                                          "BA_SGTYPE_",
                                                          "BO_TX_BU_",
                                                          "BU_BO_REL_",
                                                          "BU_EV_REL_",
                                                          "BU_SG_REL_",
                                                          "CAT_",
                                                          "CAT_DEF_",
                                                          "CM_",
                                                          "ENVVAR_DATA_",
                                                          "EV_",
                                                          "EV_DATA_",
                                                          "FILTER",
                                                          "NS_DESC_",
                                                          "SGTYPE_",
                                                          "SGTYPE_VAL_",
                                                          "SIGTYPE_VALTYPE_",
                                                          "SIG_GROUP_",
                                                          "SIG_TYPE_REF_",
                                                          "VAL_",
                                                          "VAL_TABLE_"};
constexpr std::array<std::string_view, 8> kRead = {"VERSION", "NS_", "BS_",          "BU_",
                                                   "BO_",     "SG_", "SIG_VALTYPE_", "SG_MUL_VAL_"};

bool passed_over(std::string_view word) {
  return std::find(kPassedOver.begin(), kPassedOver.end(), word) != kPassedOver.end();
}
bool keyword(std::string_view word) {
  return passed_over(word) || std::find(kRead.begin(), kRead.end(), word) != kRead.end();
}

template <typename Integer>
std::optional<Integer> whole(std::string_view text) {
  Integer value = 0;
  const auto [end, fault] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (text.empty() || fault != std::errc{} || end != text.data() + text.size()) return std::nullopt;
  return value;
}

class Parser {
 public:
  Parser(std::string_view text, std::string name) : lexer_(text), name_(std::move(name)) {
    step();
    step();
  }

  Expected<std::vector<DbcMessage>> run() {
    while (token_.kind != Token::Kind::end) {
      if (token_.kind != Token::Kind::name) return unexpected("a section such as BO_");
      if (auto done = section(); !done) return done.error();
    }
    settle();
    return std::move(messages_);
  }

 private:
  using Kind = Token::Kind;
  using SignalKey = std::pair<std::uint32_t, std::string_view>;
  struct Place {
    std::size_t message = 0, signal = 0;
  };
  // What the file says of a signal beyond DbcSignal.
  struct Extra {
    bool multiplexer = false;
    std::optional<std::uint64_t> value;  // of the multiplexer, when multiplexed
  };

  void step() {
    token_ = ahead_;
    ahead_ = lexer_.next();
  }
  [[nodiscard]] Error error_at(std::size_t line, const std::string& what) const {
    return data_error(name_ + ':' + std::to_string(line) + ": " + what);
  }
  [[nodiscard]] Error error(const std::string& what) const { return error_at(token_.line, what); }
  [[nodiscard]] Error unexpected(const std::string& wanted) const {
    if (token_.kind == Kind::end)
      return error("expected " + wanted + ", found the end of the file");
    if (token_.kind == Kind::open_text)
      return error("a text that begins with " + in_quotes(token_.text.substr(0, 30)) +
                   " does not end; add the closing quotation mark");
    return error("expected " + wanted + ", found " + in_quotes(token_.text));
  }
  bool take(std::string_view symbol) {
    if (token_.kind != Kind::symbol || token_.text != symbol) return false;
    step();
    return true;
  }
  Expected<Done> need(std::string_view symbol) {
    if (!take(symbol)) return unexpected(in_quotes(symbol));
    return Done{};
  }
  Expected<std::string_view> name(const std::string& wanted) {
    if (token_.kind != Kind::name) return unexpected(wanted);
    const std::string_view text = token_.text;
    step();
    return text;
  }
  template <typename Integer>
  Expected<Integer> integer(const std::string& wanted) {
    const auto value = token_.kind == Kind::number ? whole<Integer>(token_.text) : std::nullopt;
    if (!value) return unexpected(wanted);
    step();
    return *value;
  }
  Expected<double> real(const std::string& wanted) {
    const auto value = parse_number(token_.kind == Kind::number ? token_.text : "");
    if (!value.ok()) return unexpected(wanted);
    step();
    return value.value;
  }

  Expected<Done> section() {
    const std::string_view word = token_.text;
    if (word == "BO_") return message();
    if (word == "SG_") return error("a signal (SG_) outside a message (BO_)");
    if (word == "SIG_VALTYPE_") return value_type();
    if (word == "SG_MUL_VAL_") return extended_multiplexing();
    if (passed_over(word)) return pass_over();
    if (!keyword(word)) {
      std::vector<std::string_view> known(kPassedOver.begin(), kPassedOver.end());
      known.insert(known.end(), kRead.begin(), kRead.end());
      return error("unknown section " + in_quotes(word) + "; the nearest known one is '" +
                   std::string(nearest_name(word, known)) + "'");
    }
    step();
    if (word == "VERSION") {
      if (token_.kind != Kind::text) return unexpected("a version in quotation marks");
      step();
      return Done{};
    }
    if (word == "NS_") {  // words, each on a line of its own, that are sections elsewhere
      take(":");
      while (token_.kind == Kind::name && token_.text != "BS_" && token_.text != "BU_" &&
             (!token_.first || ahead_.first))
        step();
      return Done{};
    }
    take(":");  // BS_, BU_: up to the next section
    while (token_.kind != Kind::end && !(token_.kind == Kind::name && keyword(token_.text))) step();
    return Done{};
  }

  Expected<Done> pass_over() {
    const std::string section(token_.text);
    const Error open = error("the section " + section + " does not end with ';'");
    do {
      if (token_.kind == Kind::open_text) return unexpected("");
      step();
      // Rather than swallow messages up to the next semicolon.
      const bool message = token_.kind == Kind::name && token_.text == "BO_" && token_.first;
      if (token_.kind == Kind::end || message) return open;
    } while (!take(";"));
    return Done{};
  }

  Expected<Done> message() {
    step();
    const std::size_t line = token_.line;
    const auto id = integer<std::uint32_t>("the identifier of a message");
    if (!id) return id.error();
    const auto title = name("the name of a message");
    if (!title) return title.error();
    if (auto done = need(":"); !done) return done;
    const auto bytes = integer<std::uint32_t>("the bytes of the message");
    if (!bytes) return bytes.error();
    const Token sender = token_;
    if (sender.kind == Kind::name && !sender.first && !keyword(sender.text)) step();
    const bool extended = (*id & kExtended) != 0;
    if (*id != kIndependentSignals && (*id & ~kExtended) > (extended ? 0x1FFFFFFFU : 0x7FFU))
      return error_at(line, "message " + in_quotes(*title) + " has the identifier " +
                                std::to_string(*id) +
                                "; expected 0 to 2047, or 2147483648 and more for one of 29 bits");
    if (!ids_.insert(*id).second)
      return error_at(line, "a second message with the identifier " + std::to_string(*id));
    if (!names_.insert(*title).second)
      return error_at(line, "a second message with the name " + in_quotes(*title));
    messages_.push_back({std::string(*title), *id, *bytes, {}});
    extras_.emplace_back();
    while (token_.kind == Kind::name && token_.text == "SG_")
      if (auto done = signal(*id); !done) return done;
    return Done{};
  }

  Expected<Done> signal(std::uint32_t id) {
    step();
    const std::size_t line = token_.line;
    const auto title = name("the name of a signal");
    if (!title) return title.error();
    DbcSignal signal;
    signal.name = std::string(*title);
    Extra extra;
    const bool bare = token_.kind == Kind::name && token_.text == "m";  // SG_MUL_VAL_ says when
    if (bare) {
      signal.outside = kExtendedMultiplexing;
      step();
    }
    if (!bare && token_.kind == Kind::name) {
      std::string_view mark = token_.text;
      if (mark.starts_with('m')) {
        const std::size_t end = mark.ends_with('M') ? mark.size() - 1 : mark.size();
        extra.value = whole<std::uint64_t>(mark.substr(1, end - 1));
        if (!extra.value) return unexpected("M or mNUMBER of a multiplexed signal");
        mark.remove_prefix(end);
      }
      extra.multiplexer = mark == "M";
      if (!mark.empty() && mark != "M") return unexpected("M or mNUMBER of a multiplexed signal");
      step();
    }
    if (auto done = need(":"); !done) return done;
    if (auto done = layout(signal); !done) return done;
    if (auto done = scaling(signal); !done) return done;
    if (token_.kind != Kind::text) return unexpected("a unit in quotation marks");
    signal.unit = std::string(token_.text);
    step();
    // Receivers; after a comma they may go on in the next line.
    for (bool comma = false;; step()) {
      const bool receiver =
          token_.kind == Kind::name && !keyword(token_.text) && (!token_.first || comma);
      comma = token_.kind == Kind::symbol && token_.text == ",";
      if (!receiver && !comma) break;
    }

    DbcMessage& message = messages_.back();
    if (!places_.emplace(std::pair(id, *title), Place{messages_.size() - 1, message.signals.size()})
             .second)
      return error_at(line, "a second signal " + in_quotes(*title) + " in the message " +
                                in_quotes(message.name));
    message.signals.push_back(std::move(signal));
    extras_.back().push_back(extra);
    return Done{};
  }

  // : 7|16@0+
  Expected<Done> layout(DbcSignal& signal) {
    const auto start = integer<std::uint32_t>("the first bit of a signal");
    if (!start) return start.error();
    if (auto done = need("|"); !done) return done;
    const auto bits = integer<std::uint32_t>("the length of a signal in bits");
    if (!bits) return bits.error();
    if (*start > 0xFFFF || *bits < 1 || *bits > 64)
      return error("signal " + in_quotes(signal.name) + " has " + std::to_string(*bits) +
                   " bits from bit " + std::to_string(*start) +
                   " on; expected 1 to 64 bits within the message");
    if (auto done = need("@"); !done) return done;
    const auto order = integer<std::uint32_t>("a byte order, 0 (big-endian) or 1 (little-endian)");
    if (!order) return order.error();
    if (*order > 1) return error("expected a byte order 0 (big-endian) or 1 (little-endian)");
    // The file counts a byte's bits from the least significant one in either order.
    signal.bits.big_endian = *order == 0;
    signal.bits.start_bit = signal.bits.big_endian ? *start / 8 * 8 + 7 - *start % 8 : *start;
    signal.bits.bits = *bits;
    if (take("-"))
      signal.bits.kind = BitField::Kind::signed_integer;
    else if (!take("+"))
      return unexpected("a sign + (unsigned) or - (signed)");
    return Done{};
  }

  // (0.5,-40) [0|0]
  Expected<Done> scaling(DbcSignal& signal) {
    if (auto done = need("("); !done) return done;
    const auto factor = real("the factor of a signal");
    if (!factor) return factor.error();
    if (auto done = need(","); !done) return done;
    const auto offset = real("the offset of a signal");
    if (!offset) return offset.error();
    if (auto done = need(")"); !done) return done;
    if (auto done = need("["); !done) return done;
    while (token_.kind == Kind::number || token_.kind == Kind::name ||
           (token_.kind == Kind::symbol && token_.text != "]" && token_.text != ";"))
      step();  // the range: no matter
    if (auto done = need("]"); !done) return done;
    signal.factor = *factor;
    signal.offset = *offset;
    return Done{};
  }

  // A signal by identifier and name, for settle().
  Expected<SignalKey> signal_key() {
    const auto id = integer<std::uint32_t>("the identifier of a message");
    if (!id) return id.error();
    const auto title = name("the name of a signal");
    if (!title) return title.error();
    return SignalKey{*id, *title};
  }

  // SIG_VALTYPE_ 256 Torque : 1;
  Expected<Done> value_type() {
    step();
    const auto key = signal_key();
    if (!key) return key.error();
    take(":");
    const auto type = integer<std::uint32_t>("a value type 0 to 3");
    if (!type) return type.error();
    value_types_.emplace_back(*key, *type);
    return need(";");
  }
  static void set_value_type(DbcSignal& signal, std::uint32_t type) {
    if (type == 0) return;
    if ((type == 1 && signal.bits.bits == 32) || (type == 2 && signal.bits.bits == 64))
      signal.bits.kind = BitField::Kind::real;
    else
      signal.outside = "has the value type " + std::to_string(type) + " and " +
                       std::to_string(signal.bits.bits) +
                       " bits; read are floats of 32 (type 1) and 64 (type 2)";
  }

  // SG_MUL_VAL_ 256 Torque Mode 3-3;  Says no more than SG_ if it is one value.
  Expected<Done> extended_multiplexing() {
    step();
    const auto key = signal_key();
    if (!key) return key.error();
    const auto multiplexer = name("the name of a multiplexer");
    if (!multiplexer) return multiplexer.error();
    std::vector<std::string_view> numbers;
    while (token_.kind == Kind::number || (token_.kind == Kind::symbol && token_.text != ";")) {
      if (token_.kind == Kind::number) numbers.push_back(token_.text);
      step();
    }
    const bool one = numbers.size() == 2 && numbers[1].substr(1) == numbers[0];
    ranges_.emplace_back(*key, one ? whole<std::uint64_t>(numbers[0]) : std::nullopt);
    return need(";");
  }

  // What can be said only when the whole file is known.
  void settle() {
    for (const auto& [key, type] : value_types_)
      if (const auto at = places_.find(key); at != places_.end())
        set_value_type(messages_[at->second.message].signals[at->second.signal], type);
    for (const auto& [key, value] : ranges_)
      if (const auto at = places_.find(key); at != places_.end()) {
        const Extra& extra = extras_[at->second.message][at->second.signal];
        if (!value || extra.value != value || extra.multiplexer)
          messages_[at->second.message].signals[at->second.signal].outside = kExtendedMultiplexing;
      }
    for (std::size_t m = 0; m < messages_.size(); ++m) {
      DbcMessage& message = messages_[m];
      const DbcSignal* multiplexer = nullptr;
      std::size_t multiplexers = 0;
      bool nested = false;
      for (std::size_t s = 0; s < message.signals.size(); ++s) {
        if (!extras_[m][s].multiplexer) continue;
        multiplexer = &message.signals[s];
        ++multiplexers;
        nested = nested || extras_[m][s].value;
      }
      for (std::size_t s = 0; s < message.signals.size(); ++s) {
        DbcSignal& signal = message.signals[s];
        if (const auto value = extras_[m][s].value) {
          if (multiplexers == 1 && !nested)
            signal.multiplexing = Multiplexing{multiplexer->bits, *value};
          else if (signal.outside.empty())
            signal.outside = multiplexers == 0
                                 ? "is multiplexed, but its message has no multiplexer"
                                 : kExtendedMultiplexing;
        }
        judge(message, signal);
      }
    }
  }

  static void judge(const DbcMessage& message, DbcSignal& signal) {
    const auto within = [&](const BitField& field) {
      return field.start_bit + field.bits <= 8 * message.bytes;
    };
    if (!signal.outside.empty()) return;
    if (message.key == kIndependentSignals)
      signal.outside = "belongs to no frame";
    else if (message.bytes > CanFrame::kMaxBytes)
      signal.outside = "is in a message of " + std::to_string(message.bytes) +
                       " bytes, which travels in several frames; read are messages of one frame, "
                       "64 bytes at most";
    else if (!within(signal.bits))
      signal.outside =
          "reaches beyond the " + std::to_string(message.bytes) + " bytes of its message";
    else if (signal.factor == 0)
      signal.outside = "has a factor of 0";
    else if (signal.multiplexing && (!within(signal.multiplexing->field) ||
                                     signal.multiplexing->field.kind == BitField::Kind::real))
      signal.outside = "has a multiplexer that is no whole number within the message";
    else if (signal.multiplexing) {
      // Compared bit by bit.
      signal.multiplexing->field.kind = BitField::Kind::unsigned_integer;
      const unsigned bits = signal.multiplexing->field.bits;
      if (bits < 64 && signal.multiplexing->value >> bits != 0)
        signal.outside = "is multiplexed by a value that the multiplexer cannot have";
    }
  }

  static constexpr const char* kExtendedMultiplexing =
      "is multiplexed by several multiplexers or ranges of values; read is one multiplexer a "
      "message with one value a signal";

  Lexer lexer_;
  std::string name_;
  Token token_, ahead_;
  std::vector<DbcMessage> messages_;
  std::vector<std::vector<Extra>> extras_;  // by message and signal
  std::set<std::uint32_t> ids_;
  std::set<std::string_view> names_;
  std::map<SignalKey, Place> places_;
  std::vector<std::pair<SignalKey, std::uint32_t>> value_types_;
  std::vector<std::pair<SignalKey, std::optional<std::uint64_t>>> ranges_;
};

template <typename Named>
std::string nearest(std::string_view name, const std::vector<Named>& all) {
  std::vector<std::string_view> names;
  for (const Named& one : all) names.push_back(one.name);
  return std::string(nearest_name(name, names));
}

}  // namespace

Expected<Dbc> Dbc::parse(std::string_view text, std::string name) {
  Dbc dbc;
  dbc.name_ = printable(name, 400);
  auto messages = Parser(text, dbc.name_).run();
  if (!messages) return messages.error();
  dbc.messages_ = std::move(*messages);
  return dbc;
}

Expected<Dbc> Dbc::read(const std::string& path) {
  auto stream = open_for_reading(path);
  if (!stream) return stream.error();
  std::string text;
  std::array<char, 1 << 16> block;
  do {
    (*stream)->read(block.data(), block.size());
    text.append(block.data(), static_cast<std::size_t>((*stream)->gcount()));
    if (text.size() > kLongestFile)
      return data_error(printable(path, 400) + ":1: is longer than 16 MiB; give a DBC file");
  } while (**stream);
  if ((*stream)->bad())
    return device_error(printable(path, 400) +
                        ": reading failed; check the disk or the connection");
  return parse(text, path);
}

Expected<Dbc::Found> Dbc::find(std::string_view path) const {
  const std::size_t dot = path.find('.');
  if (dot == std::string_view::npos)
    return data_error("expected MESSAGE.SIGNAL of " + name_ + ", found " + in_quotes(path));
  const std::string_view of = path.substr(0, dot), wanted = path.substr(dot + 1);
  const auto message = std::find_if(messages_.begin(), messages_.end(),
                                    [&](const DbcMessage& m) { return m.name == of; });
  if (message == messages_.end())
    return data_error(name_ + " has no message " + in_quotes(of) +
                      (messages_.empty() ? ", nor any other"
                                         : "; the nearest is '" + nearest(of, messages_) + "'"));
  const auto& signals = message->signals;
  const auto signal = std::find_if(signals.begin(), signals.end(),
                                   [&](const DbcSignal& s) { return s.name == wanted; });
  if (signal == signals.end())
    return data_error("the message " + in_quotes(of) + " of " + name_ + " has no signal " +
                      in_quotes(wanted) +
                      (signals.empty() ? ", nor any other"
                                       : "; the nearest is '" + nearest(wanted, signals) + "'"));
  if (!signal->outside.empty()) return data_error(in_quotes(path) + ' ' + signal->outside);
  return Found{message->key, *signal};
}

}  // namespace servosense
