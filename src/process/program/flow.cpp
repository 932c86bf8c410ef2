#include "flow.hpp"

#include <algorithm>
#include <cmath>

#include "servosense/io/line_reader.hpp"
#include "servosense/io/text.hpp"

namespace servosense::process {
namespace {

std::string o_word(std::string_view label) {
  return "O" + std::string(label.substr(
                   label.find('#') == std::string_view::npos ? 0 : label.find('#') + 1));
}

}  // namespace

std::string Flow::scope() const {
  if (!calls_.empty()) return calls_.back().name;
  return defining_ ? defined_ : std::string();
}

void Flow::skip_to(const std::string& label) {
  skipping_ = label;
  skipping_from_ = line_of_file_;
}

Refusal Flow::end_of_file() {
  if (skips())
    return refuse("the program ends before " + o_word(skipping_) + ", which line " +
                  std::to_string(skipping_from_) +
                  " goes to; is its end or its subroutine missing?");
  if (percent_) return refuse("the file ends without M2, M30 or a second '%'; is its end missing?");
  return refuse("the file ends without M2, M30 or '%' lines; is its end missing?");
}

Refusal Flow::step() {
  if (++lines_run_ > options_.most_lines)
    return refuse("the program has run " + std::to_string(options_.most_lines) +
                  " lines without coming to its end; does a loop here never end?");
  if (here_.next >= here_.file->lines().size()) return end_of_file();
  const std::string& raw = here_.file->lines()[here_.next++];
  file_of_line_ = here_.file;
  line_of_file_ = here_.next;
  machine_.file_line = here_.next;
  if (here_.file == main_) machine_.line = here_.next;
  return read_text(raw);
}

Refusal Flow::read_text(const std::string& raw) {
  const std::string_view bare = trim(raw);
  if (bare == "%") {
    const auto& lines = here_.file->lines();
    const bool first =
        std::all_of(lines.begin(), lines.begin() + static_cast<std::ptrdiff_t>(here_.next - 1),
                    [](const std::string& l) { return trim(l).empty(); });
    if (first) {
      percent_ = percent_ || here_.file == main_;
      return std::nullopt;
    }
    if (percent_ && here_.file == main_) return skips() ? end_of_file() : machine_.end_program();
    return refuse("a '%' ends the file, but none begins it; put one on the first line");
  }
  const auto tidy = tidy_line(raw);
  if (!tidy) return tidy.error();
  std::string_view line = *tidy;
  if (line.starts_with('/')) {
    if (options_.block_delete) return std::nullopt;
    line.remove_prefix(1);
  }
  return read_line(line);
}

Refusal Flow::read_line(std::string_view line) {
  Cursor cursor{line};
  if (cursor.take("n")) {
    const std::size_t begin = cursor.at;
    while ((cursor.next() >= '0' && cursor.next() <= '9') || cursor.next() == '.') ++cursor.at;
    if (begin == cursor.at) return refuse("N is followed by the number of the line");
  }
  if (options_.dialect == Dialect::fanuc && !skips()) {
    const auto done = fanuc_line(cursor);
    if (!done) return done.error();
    if (*done) return std::nullopt;
  }
  const bool jumps = cursor.next() == 'o' || Cursor(cursor).take("m98") ||
                     (Cursor(cursor).take("m99") && !calls_.empty());
  if (jumps) {
    const auto o = read_o_word(cursor);
    if (!o) return o.error();
    return control(*o);
  }
  if (skips()) return std::nullopt;
  const auto block = read_block(cursor, machine_);
  if (!block) return block.error();
  return machine_.execute(*block);
}

// ---- carrying it out
// -----------------------------------------------------------------------------

Refusal Flow::control(const OWord& o) {
  if (o.word == Word::none) return std::nullopt;
  if (skips() && skipping_ != o.name) return std::nullopt;
  if (seeking_sub_ && o.word != Word::sub && o.word != Word::number) return std::nullopt;
  switch (o.word) {
    case Word::sub:
    case Word::number:
      return open_sub(o);
    case Word::endsub:
    case Word::back:
    case Word::return_99:
      return leave_sub(o);
    case Word::call:
    case Word::call_98:
      return call(o);
    case Word::loop_do:
    case Word::repeat:
    case Word::loop_while:
      return open_loop(o);
    case Word::when:
    case Word::elsewhen:
    case Word::otherwise:
    case Word::endwhen:
      return branch(o);
    case Word::leave:
    case Word::next_turn:
      return leave_loop(o);
    case Word::endwhile:
    case Word::endrepeat:
      return close_loop(o);
    case Word::none:
      break;
  }
  return std::nullopt;
}

Refusal Flow::define(const OWord& o) {
  const auto [found, made] =
      labels_.try_emplace(o.name, Label{o.word, {here_.file, here_.next - 1}, -1});
  if (!made)
    return refuse(o_word(o.name) + " stands twice; line " +
                  std::to_string(found->second.at.next + 1) + " has it too");
  return std::nullopt;
}

Expected<const Flow::Label*> Flow::label_of(const OWord& o,
                                            std::initializer_list<Word> words) const {
  const auto found = labels_.find(o.name);
  if (found == labels_.end())
    return data_error(o_word(o.name) + " begins nowhere before this line");
  if (std::find(words.begin(), words.end(), found->second.word) == words.end())
    return data_error(o_word(o.name) + " does not end what line " +
                      std::to_string(found->second.at.next + 1) + " begins");
  return &found->second;
}

Refusal Flow::open_sub(const OWord& o) {
  if (!calls_.empty()) {
    const bool fanuc = calls_.back().word == Word::call_98;
    if (o.word == Word::number && !fanuc)
      return refuse("a subroutine that begins with O" + o.name + " alone is called with M98");
    if (o.word == Word::sub && fanuc)
      return refuse("a subroutine that begins with SUB is called with O" + o.name + " CALL");
  }
  if (skips()) {
    no_longer_skip();
    if (auto no = define(o)) return no;
  }
  const bool sought = seeking_sub_;
  seeking_sub_ = false;
  if (o.word == Word::number || !calls_.empty() || sought) return std::nullopt;
  if (auto no = define(o)) return no;
  skip_to(o.name);
  defining_ = true;
  defined_ = o.name;
  return std::nullopt;
}

Refusal Flow::leave_sub(const OWord& o) {
  if (calls_.empty()) {
    if (!defining_) return refuse("O" + o.name + " ends a subroutine, and none has begun");
    if (o.word == Word::endsub) {
      no_longer_skip();
      defining_ = false;
    }
    return std::nullopt;
  }
  const Call& call = calls_.back();
  if (call.word == Word::call_98 && o.word != Word::return_99)
    return refuse("a subroutine called with M98 ends with M99");
  if (call.word == Word::call && o.word == Word::return_99)
    return refuse("a subroutine called with O CALL ends with ENDSUB or RETURN");
  if (o.word == Word::endsub) no_longer_skip();
  machine_.returned.reset();
  if (o.has_value) machine_.returned = o.value;
  if (call.word == Word::call)
    std::copy(call.arguments.begin(), call.arguments.end(), machine_.parameters.begin() + 1);
  const Machine::Frame frame = std::move(machine_.frames.back());
  machine_.frames.pop_back();
  here_ = call.back;
  calls_.pop_back();
  if (frame.restore_on_return && frame.saved) return machine_.restore(*frame.saved);
  return std::nullopt;
}

Refusal Flow::call(const OWord& o) {
  if (calls_.size() >= kDeepestCall)
    return refuse("subroutines call each other more than " + std::to_string(kDeepestCall) +
                  " deep; does one call itself?");
  if (o.repeats && *o.repeats <= 0) return std::nullopt;
  Call call;
  call.name = o.name;
  call.word = o.word;
  call.back = here_;
  if (o.word == Word::call) {
    std::copy_n(machine_.parameters.begin() + 1, kCallArguments, call.arguments.begin());
    for (std::size_t i = 0; i < kCallArguments; ++i)
      machine_.parameters[i + 1] = i < o.arguments.size() ? o.arguments[i] : 0;
  } else if (o.repeats) {
    // Comes back to its own line until it has been carried out often enough.
    Label& counter = labels_[std::to_string(here_.next) + " M98 " + here_.file->name()];
    if (counter.repeats < 0) counter.repeats = *o.repeats;
    if (--counter.repeats > 0)
      --call.back.next;
    else
      counter.repeats = -1;
  }
  calls_.push_back(call);
  machine_.frames.emplace_back();
  return jump_to_sub(o.name);
}

Refusal Flow::jump_to_sub(const std::string& name) {
  if (const auto found = labels_.find(name); found != labels_.end()) {
    here_ = found->second.at;
    return std::nullopt;
  }
  skip_to(name);
  seeking_sub_ = true;
  auto other = main_->subroutine(name);
  if (!other) return other.error();
  if (*other) {
    files_.push_back(std::move(**other));
    here_ = {&files_.back(), 0};
  }
  return std::nullopt;
}

Refusal Flow::open_loop(const OWord& o) {
  const auto found = labels_.find(o.name);
  const bool again = found != labels_.end();
  const bool ends_do = again && o.word == Word::loop_while && found->second.word == Word::loop_do;
  if (ends_do) {
    no_longer_skip();
    continues_ = false;
    if (o.value != 0 && !breaks_) here_ = found->second.at;
    breaks_ = false;
    return std::nullopt;
  }
  if (again && (found->second.at.next + 1 != here_.next || found->second.at.file != here_.file))
    return o.word == Word::loop_do ? (no_longer_skip(), std::nullopt) : define(o);
  if (!again)
    if (auto no = define(o)) return no;
  no_longer_skip();
  Label& label = labels_.at(o.name);
  if (label.word != o.word || o.word == Word::loop_do) return std::nullopt;
  bool goes_on = o.value != 0;
  if (o.word == Word::repeat) {
    if (label.repeats < 0)
      label.repeats = std::lround(std::clamp(std::nearbyint(o.value), 0.0, 1e15));
    goes_on = label.repeats > 0;
    --label.repeats;
  }
  if (!goes_on) {
    label.repeats = -1;
    skip_to(o.name);
  }
  return std::nullopt;
}

Refusal Flow::branch(const OWord& o) {
  if (o.word == Word::when) {
    const auto found = labels_.find(o.name);
    if (found == labels_.end()) {
      if (auto no = define(o)) return no;
    } else if (found->second.at.next + 1 != here_.next || found->second.at.file != here_.file) {
      return define(o);
    }
    executed_if_ = o.value != 0;
    if (executed_if_)
      no_longer_skip();
    else
      skip_to(o.name);
    return std::nullopt;
  }
  if (const auto label = label_of(o, {Word::when}); !label) return label.error();
  if (o.word == Word::endwhen) {
    no_longer_skip();
    executed_if_ = true;
  } else if (executed_if_) {
    skip_to(o.name);
  } else if (o.word == Word::otherwise || o.value != 0) {
    no_longer_skip();
    executed_if_ = true;
  }
  return std::nullopt;
}

Refusal Flow::leave_loop(const OWord& o) {
  if (const auto label = label_of(o, {Word::loop_while, Word::loop_do}); !label)
    return label.error();
  if (skips() && o.word == Word::next_turn) return std::nullopt;
  skip_to(o.name);
  (o.word == Word::leave ? breaks_ : continues_) = true;
  return std::nullopt;
}

Refusal Flow::close_loop(const OWord& o) {
  const auto label =
      o.word == Word::endrepeat ? label_of(o, {Word::repeat}) : label_of(o, {Word::loop_while});
  if (!label) return label.error();
  const bool skipped = skips();
  no_longer_skip();
  if (!skipped || continues_) here_ = (*label)->at;
  continues_ = false;
  return std::nullopt;
}

// ---- the whole program
// ---------------------------------------------------------------------------

Expected<Done> run_program(const ProgramText& program, const ProgramOptions& options,
                           const std::function<void(const CanonicalMove&)>& sink,
                           ProgramPlace* place) {
  Machine machine(options, sink);
  Flow flow(program, options, machine);
  while (!machine.ended()) {
    const Refusal no = flow.step();
    if (!no) continue;
    const ProgramPlace at = flow.place();
    if (place != nullptr) *place = at;
    return Error{no->kind, at.file + ":" + std::to_string(at.line) + ": " + no->sentence};
  }
  return Done{};
}

}  // namespace servosense::process
