// BehaviorTree.CPP runs a tree that comes over stdin, and tells over stdout what each tick or halt did.
//   tree BYTES\nXML   answers NAME LETTERS   load   tick   halt      (`answers` before `load`)
// Each answer is some lines and a line with a dot: "status S", "refused WORDS", "raised WORDS", "event WORDS",
// "change NAME OLD NEW", "value NAME NUMBER".
#include <behaviortree_cpp/bt_factory.h>
#include <behaviortree_cpp/loggers/abstract_logger.h>

#include <iostream>
#include <map>
#include <sstream>

using namespace BT;
enum class Colour { RED = 1, GREEN = 2, BLUE = 5 };

namespace BT {
template <> inline Colour convertFromString(StringView text) {
  if (text == "RED") return Colour::RED;
  if (text == "GREEN") return Colour::GREEN;
  if (text == "BLUE") return Colour::BLUE;
  return static_cast<Colour>(convertFromString<int>(text));
}
}  // namespace BT

namespace {
std::map<std::string, std::string> answers;
std::map<std::string, size_t> turns;
std::vector<std::string> lines;

void told(const std::string& line) {
  std::string one = line;
  for (auto& c : one) if (c == '\n') c = ' ';
  lines.push_back(one);
}

NodeStatus answer(const std::string& name, const std::string& event) {
  told("event " + event + " " + name);
  const auto& letters = answers[name];
  char letter = letters[turns[name]++ % letters.size()];
  if (letter == 'K' && event == "poll") letter = 'S';  // a leaf that runs cannot be skipped
  return letter == 'S' ? NodeStatus::SUCCESS : letter == 'F' ? NodeStatus::FAILURE
       : letter == 'R' ? NodeStatus::RUNNING : NodeStatus::SKIPPED;
}

struct Leaf : StatefulActionNode {
  using StatefulActionNode::StatefulActionNode;
  static PortsList providedPorts() { return {}; }
  NodeStatus onStart() override { return answer(name(), "start"); }
  NodeStatus onRunning() override { return answer(name(), "poll"); }
  void onHalted() override { told("event halt " + name()); }
};

std::string shown(double value) { std::ostringstream text; text << value; return text.str(); }
std::string shown(int value) { return std::to_string(value); }
std::string shown(bool value) { return value ? "1" : "0"; }
std::string shown(const std::string& value) { return value; }
std::string shown(Colour value) { return std::to_string(static_cast<int>(value)); }
template <typename T> std::string shown(const std::vector<T>& values) {
  std::string text;
  for (const T& one : values) text += shown(one) + ";";
  return text;
}

template <typename T> struct Read : SyncActionNode {
  using SyncActionNode::SyncActionNode;
  static PortsList providedPorts() { return {InputPort<T>("v")}; }
  NodeStatus tick() override {
    auto value = getInput<T>("v");
    told("event read " + name() + " " + (value ? shown(value.value()) : "-"));
    return value ? NodeStatus::SUCCESS : NodeStatus::FAILURE;
  }
};

struct ReadOwn : SyncActionNode {  // what its ports name by themselves
  using SyncActionNode::SyncActionNode;
  static PortsList providedPorts() { return {InputPort<int>("n", "{=}", ""), InputPort<int>("m", "{@n}", "")}; }
  NodeStatus tick() override {
    auto n = getInput<int>("n"), m = getInput<int>("m");
    told("event read " + name() + " " + (n ? shown(n.value()) : "-") + " " + (m ? shown(m.value()) : "-"));
    return n && m ? NodeStatus::SUCCESS : NodeStatus::FAILURE;
  }
};

template <typename T> struct Write : SyncActionNode {
  Write(const std::string& name, const NodeConfig& config, T value) : SyncActionNode(name, config), value_(value) {}
  static PortsList providedPorts() { return {OutputPort<T>("v")}; }
  NodeStatus tick() override { return setOutput("v", value_) ? NodeStatus::SUCCESS : NodeStatus::FAILURE; }
  T value_;
};

struct Log : StatusChangeLogger {
  explicit Log(TreeNode* root) : StatusChangeLogger(root) { enableTransitionToIdle(true); }
  void callback(Duration, const TreeNode& node, NodeStatus before, NodeStatus after) override {
    told("change " + node.name() + " " + toStr(before) + " " + toStr(after));
  }
  void flush() override {}
};

void registered(BehaviorTreeFactory& factory) {
  factory.registerNodeType<Leaf>("Leaf");
  factory.registerSimpleCondition("Check", [](TreeNode& node) { return answer(node.name(), "start"); });
  factory.registerNodeType<Read<int>>("ReadInt");
  factory.registerNodeType<Read<double>>("ReadDouble");
  factory.registerNodeType<Read<bool>>("ReadBool");
  factory.registerNodeType<Read<std::string>>("ReadText");
  factory.registerNodeType<Read<Colour>>("ReadColour");
  factory.registerNodeType<Read<std::vector<int>>>("ReadInts");
  factory.registerNodeType<Read<std::vector<double>>>("ReadDoubles");
  factory.registerNodeType<Read<std::vector<std::string>>>("ReadTexts");
  factory.registerNodeType<ReadOwn>("ReadOwn");
  factory.registerNodeType<Write<int>>("WriteInt", 7);
  factory.registerNodeType<Write<double>>("WriteDouble", 1.5);
  factory.registerNodeType<Write<bool>>("WriteBool", true);
  factory.registerNodeType<Write<std::string>>("WriteText", std::string("12"));
  factory.registerNodeType<Write<Colour>>("WriteColour", Colour::GREEN);
  factory.registerScriptingEnums<Colour>();
}

void finished(Tree& tree, const std::vector<std::string>& names) {
  for (const auto& name : names) {
    std::string text = "-";
    try { text = shown(tree.rootBlackboard()->get<double>(name)); } catch (const std::exception&) {}
    told("value " + name + " " + text);
  }
}
}  // namespace

int main(int count, char** arguments) {
  const std::vector<std::string> names(arguments + 1, arguments + count);  // entries that are told
  std::string word, xml;
  std::unique_ptr<BehaviorTreeFactory> factory;
  std::unique_ptr<Tree> tree;
  std::unique_ptr<Log> log;
  while (std::cin >> word) {
    lines.clear();
    try {
      if (word == "tree") {
        size_t bytes = 0;
        std::cin >> bytes;
        std::cin.get();
        xml.assign(bytes, ' ');
        std::cin.read(xml.data(), static_cast<std::streamsize>(bytes));
        answers.clear();
        turns.clear();
      } else if (word == "answers") {
        std::string name, letters;
        std::cin >> name >> letters;
        answers[name] = letters;
      } else if (word == "load") {
        log.reset();
        tree.reset();
        factory = std::make_unique<BehaviorTreeFactory>();
        registered(*factory);
        try {
          factory->registerBehaviorTreeFromText(xml);
          tree = std::make_unique<Tree>(factory->createTree("Main"));
          log = std::make_unique<Log>(tree->rootNode());
        } catch (const std::exception& error) {
          told(std::string("refused ") + error.what());
        }
      } else if (word == "halt") {
        tree->haltTree();
        finished(*tree, names);
      } else {
        const auto status = tree->tickExactlyOnce();
        told("status " + toStr(status));
        finished(*tree, names);
      }
    } catch (const std::exception& error) {
      told(std::string("raised ") + error.what());
    }
    if (word != "tree" && word != "answers") {
      for (const auto& line : lines) std::cout << line << '\n';
      std::cout << "." << std::endl;
    }
  }
  if (log) log->setEnabled(false);
}
