// Which line comes next: subroutines, branches and loops, by O words or as Fanuc writes them.
#pragma once

#include <list>
#include <map>
#include <string>
#include <vector>

#include "machine.hpp"

namespace servosense::process {

class Flow {
 public:
  Flow(const ProgramText& program, const ProgramOptions& options, Machine& machine)
      : options_(options), machine_(machine), main_(&program), here_{&program, 0} {}

  /// One line. Where it stood says place().
  Refusal step();
  [[nodiscard]] ProgramPlace place() const { return {file_of_line_->name(), line_of_file_}; }

 private:
  struct Place {
    const ProgramText* file = nullptr;
    std::size_t next = 0;  // line to be read next, from 0
  };
  enum class Word {
    none,
    sub,
    endsub,
    call,
    call_98,
    return_99,
    back,
    loop_do,
    loop_while,
    repeat,
    when,
    elsewhen,
    otherwise,
    endwhen,
    leave,
    next_turn,
    endwhile,
    endrepeat,
    number
  };
  struct Label {
    Word word = Word::none;
    Place at;
    long repeats = -1;  // of a repeat loop, those that remain
  };
  struct Call {
    std::string name;
    Word word = Word::call;
    Place back;
    std::array<double, kCallArguments> arguments{};  // of the caller
  };
  struct OWord {
    Word word = Word::none;
    std::string name;
    std::vector<double> arguments;
    double value = 0;
    bool has_value = false;
    std::optional<long> repeats;  // L of M98
  };

  Refusal end_of_file();
  Refusal read_text(const std::string& raw);
  Refusal read_line(std::string_view line);
  [[nodiscard]] Expected<OWord> read_o_word(Cursor& cursor) const;
  [[nodiscard]] std::string scope() const;
  Refusal control(const OWord& o);
  Refusal open_sub(const OWord& o);
  Refusal leave_sub(const OWord& o);
  Refusal call(const OWord& o);
  Refusal jump_to_sub(const std::string& name);
  Refusal open_loop(const OWord& o);
  Refusal branch(const OWord& o);
  Refusal close_loop(const OWord& o);
  Refusal leave_loop(const OWord& o);
  Expected<const Label*> label_of(const OWord& o, std::initializer_list<Word> words) const;
  Refusal define(const OWord& o);
  void skip_to(const std::string& label);
  void no_longer_skip() { skipping_.clear(); }
  [[nodiscard]] bool skips() const { return !skipping_.empty(); }
  // Fanuc's macro language: fanuc_flow.cpp.
  Expected<bool> fanuc_line(Cursor& cursor);
  Refusal go_to(long number);
  Refusal skip_loop(long number);

  const ProgramOptions& options_;
  Machine& machine_;
  const ProgramText* main_;
  Place here_;
  const ProgramText* file_of_line_ = main_;
  std::size_t line_of_file_ = 0;
  std::uint64_t lines_run_ = 0;
  std::list<ProgramText> files_;  // of subroutines
  std::map<std::string, Label> labels_;
  std::vector<Call> calls_;
  std::string skipping_;           // label that ends it
  std::size_t skipping_from_ = 0;  // line
  bool seeking_sub_ = false, defining_ = false, executed_if_ = false;
  bool breaks_ = false, continues_ = false;
  std::string defined_;  // subroutine that is being defined
  bool percent_ = false;
  struct FanucLoop {
    long number = 0;
    Place at;
  };
  std::vector<FanucLoop> loops_;
};

}  // namespace servosense::process
