// Flamenco's side of a job type, as far as ours uses it: compiles a job and prints its tasks as JSON.
"use strict";

const fs = require("fs");

const author = {
    Task: (name, type) => ({
        name, type, commands: [], dependencies: [],
        addCommand(command) { this.commands.push(command); },
        addDependency(task) { this.dependencies.push(task.name); },
    }),
    Command: (name, parameters) => ({ name, parameters }),
};

function frameChunker(frames, size) {
    const all = frames.split(",").flatMap((range) => {
        const [first, last] = range.split("-").map(Number);
        return Array.from({ length: (last ?? first) - first + 1 }, (_, index) => first + index);
    });
    if (size !== 1) throw new Error("the stub makes chunks of one frame");
    return all.map(String);
}

const source = fs.readFileSync(process.argv[2], "utf-8");
const { JOB_TYPE, compileJob } = new Function("author", "frameChunker", `${source}; return { JOB_TYPE, compileJob };`)(
    author, frameChunker);
const settings = Object.fromEntries(JOB_TYPE.settings.map((setting) => [setting.key, setting.default]));
const job = { tasks: [], settings: { ...settings, ...JSON.parse(process.argv[3]) },
              addTask(task) { this.tasks.push(task); } };
compileJob(job);
console.log(JSON.stringify({ settings: JOB_TYPE.settings, tasks: job.tasks }));
